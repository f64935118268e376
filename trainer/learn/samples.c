// Cuts trajectories into windows of states and boundary inputs, and computes the scales of
// residuals.
#include "learn/samples.h"

#include <math.h>
#include <string.h>

#include "learn/symmetry.h"

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for training samples");
}

// Central differences need two neighbouring states on either side.
static int margin_of(pm_residual residual, const pm_dataset *d) {
    return residual == PM_RESIDUAL_DERIVATIVE && d->zdot == NULL ? 2 : 0;
}

// Computes z + dt zdot from the given rates, or by central differences if `rate` is NULL.
static void euler_target(const double *state, const double *rate, double dt, int nz,
                         double *target) {
    if (rate != NULL) {
        for (int c = 0; c < nz; ++c) {
            target[c] = state[c] + dt * rate[c];
        }
        return;
    }
    const double *before2 = state - 2 * nz, *before = state - nz;
    const double *after = state + nz, *after2 = state + 2 * nz;
    for (int c = 0; c < nz; ++c) {
        target[c] = state[c] + (before2[c] - after2[c] + 8 * (after[c] - before[c])) / 12;
    }
}

// Every group gets one scale for all components, so that scaled vectors keep their direction.
static void pool_scales(pm_samples *s, const pm_scene *scene, const double *square, long count) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_layout *layout = &scene->subsystem[i].layout;
        for (int k = 0; k < layout->ngroup; ++k) {
            const pm_group *group = &layout->group[k];
            const int first = scene->subsystem[i].first + group->first;
            double sum = 0;
            for (int c = 0; c < group->size; ++c) {
                sum += square[first + c];
            }
            const double rms = sqrt(sum / ((double)count * group->size));
            for (int c = 0; c < group->size; ++c) {
                s->scale[first + c] = rms > 0 ? rms : 1;
            }
        }
    }
}

// Cuts one trajectory of states (and of rates, unless `rate` is NULL) into windows. Returns the end
// of the windows.
static double *cut(const pm_samples *s, const double *state, const double *rate,
                   const pm_dataset *d, pm_residual residual,
                   const pm_boundary_input *boundary_input, double *window, double *square) {
    const size_t nz = (size_t)s->nz,
                 nboundary_input = (size_t)s->input_order * (size_t)s->nboundary_input;
    const int margin = margin_of(residual, d);
    // Boundary inputs have no interval after the last state.
    const int last = d->ntime - (margin > 0 ? margin : s->unroll);
    for (int j = margin; j < last; ++j) {
        const double *at = state + (size_t)j * nz;
        if (residual == PM_RESIDUAL_DERIVATIVE) {
            memcpy(window, at, nz * sizeof *at);
            euler_target(at, rate == NULL ? NULL : rate + (size_t)j * nz, d->dt, s->nz,
                         window + nz);
        } else {
            memcpy(window, at, ((size_t)s->unroll + 1) * nz * sizeof *at);
        }
        for (int step = 0; step < s->unroll && s->nboundary_input > 0; ++step) {
            memcpy(window + pm_samples_input(s, step),
                   pm_boundary_input_interval(boundary_input, j + step),
                   nboundary_input * sizeof *at);
        }
        for (size_t c = 0; c < nz; ++c) {
            const double increment = window[nz + c] - window[c];
            square[c] += increment * increment;
        }
        window += pm_samples_width(s);
    }
    return window;
}

static pm_status make(pm_samples *s, const pm_scene *scene, const pm_dataset *d, int first, int end,
                      pm_residual residual, pm_arena *scratch) {
    const int margin = margin_of(residual, d);
    const int per_trajectory = d->ntime - (margin > 0 ? 2 * margin : s->unroll);
    if (per_trajectory <= 0 || end <= first) {
        return pm_fail(PM_EDATA, "%d trajectories of %d states are too short to train on",
                       end - first, d->ntime);
    }
    pm_columns columns;
    pm_boundary_input boundary_input;
    PM_TRY(pm_columns_bind(&columns, scene, d, scratch));
    PM_TRY(pm_boundary_input_bind(&boundary_input, scene, d, 1, scratch));
    const size_t nz = (size_t)s->nz;
    s->count = per_trajectory * (end - first);
    s->z = pm_arena_array(&s->arena, (size_t)s->count * (size_t)pm_samples_width(s), sizeof *s->z);
    s->scale = pm_arena_array(&s->arena, nz, sizeof *s->scale);
    double *state = pm_arena_array(scratch, (size_t)d->ntime * nz, sizeof *state);
    double *rate = pm_arena_array(scratch, (size_t)d->ntime * nz, sizeof *rate);
    double *square = pm_arena_array(scratch, nz, sizeof *square);
    if (s->z == NULL || s->scale == NULL || state == NULL || rate == NULL || square == NULL) {
        return no_memory();
    }
    double *window = s->z;
    for (int i = first; i < end; ++i) {
        for (int j = 0; j < d->ntime; ++j) {
            pm_columns_to_state(&columns, pm_dataset_state(d, i, j), state + (size_t)j * nz);
            if (d->zdot != NULL) {
                pm_columns_to_state(&columns, pm_dataset_rate(d, i, j), rate + (size_t)j * nz);
            }
        }
        pm_boundary_input_follow(&boundary_input, d, i);
        window = cut(s, state, d->zdot == NULL ? NULL : rate, d, residual, &boundary_input, window,
                     square);
    }
    pool_scales(s, scene, square, s->count);
    return PM_OK;
}

pm_status pm_samples_make(pm_samples *samples, const pm_scene *scene, const pm_dataset *dataset,
                          int first, int end, pm_residual residual, int unroll, int input_order) {
    *samples = (pm_samples){.nz = scene->nz,
                            .nboundary_input = scene->nprescribed,
                            .input_order = input_order,
                            .unroll = residual == PM_RESIDUAL_DERIVATIVE ? 1 : unroll};
    pm_arena scratch = {0};
    const pm_status status = make(samples, scene, dataset, first, end, residual, &scratch);
    pm_arena_free(&scratch);
    if (status != PM_OK) {
        pm_samples_free(samples);
    }
    return status;
}

void pm_samples_rescale(pm_samples *samples, const double *scale) {
    for (int i = 0; i < samples->nz && scale != NULL; ++i) {
        samples->scale[i] = scale[i] > 0 ? scale[i] : samples->scale[i];
    }
}

int pm_samples_symmetry_copies(const pm_samples *s) {
    return s->symmetry == NULL ? s->count : PM_SYMMETRY_COPIES_OF_SQUARE * s->count;
}

void pm_samples_window(const pm_samples *s, int k, double *window) {
    const int width = pm_samples_width(s), image = k / s->count;
    const double *from = s->z + (size_t)(k % s->count) * (size_t)width;
    if (image == 0) {
        memcpy(window, from, (size_t)width * sizeof *window);
    } else {
        pm_symmetry_image(s->symmetry, image, width, from, window);
    }
}

void pm_samples_free(pm_samples *samples) {
    pm_arena_free(&samples->arena);
}
