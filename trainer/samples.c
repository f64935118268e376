// Cutting trajectories into windows.
#include "samples.h"

#include <math.h>
#include <string.h>

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for training samples");
}

// The derivative residual needs two neighbours on either side.
static int margin_of(pm_residual residual) {
    return residual == PM_RESIDUAL_DERIVATIVE ? 2 : 0;
}

// z + dt zdot at time j of trajectory i, all in states.
static void euler_target(const double *state, int nz, double *target) {
    const double *before2 = state - 2 * nz, *before = state - nz;
    const double *after = state + nz, *after2 = state + 2 * nz;
    for (int c = 0; c < nz; ++c) {
        target[c] = state[c] + (before2[c] - after2[c] + 8 * (after[c] - before[c])) / 12;
    }
}

// Every group of every subsystem gets one scale, so that vectors keep their direction.
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

static void cut(pm_samples *s, const double *state, int ntrajectory, int ntime,
                pm_residual residual, double *square, long *nsquare) {
    const size_t nz = (size_t)s->nz;
    const int margin = margin_of(residual);
    const int last = residual == PM_RESIDUAL_DERIVATIVE ? ntime - margin : ntime - s->unroll;
    double *window = s->z;
    for (int i = 0; i < ntrajectory; ++i) {
        for (int j = margin; j < last; ++j) {
            const double *at = state + ((size_t)i * (size_t)ntime + (size_t)j) * nz;
            if (residual == PM_RESIDUAL_DERIVATIVE) {
                memcpy(window, at, nz * sizeof *at);
                euler_target(at, s->nz, window + nz);
            } else {
                memcpy(window, at, ((size_t)s->unroll + 1) * nz * sizeof *at);
            }
            for (size_t c = 0; c < nz; ++c) {
                const double increment = window[nz + c] - window[c];
                square[c] += increment * increment;
            }
            ++*nsquare;
            window += ((size_t)s->unroll + 1) * nz;
        }
    }
}

static pm_status make(pm_samples *s, const pm_scene *scene, const pm_dataset *d, int first, int end,
                      pm_residual residual, pm_arena *scratch) {
    const int margin = margin_of(residual);
    const int per_trajectory = d->ntime - (margin > 0 ? 2 * margin : s->unroll);
    if (per_trajectory <= 0 || end <= first) {
        return pm_fail(PM_EDATA, "%d trajectories of %d states are too short to train on",
                       end - first, d->ntime);
    }
    pm_columns columns;
    PM_TRY(pm_columns_bind(&columns, scene, d, scratch));
    const size_t nz = (size_t)s->nz, rows = (size_t)(end - first) * (size_t)d->ntime;
    s->count = per_trajectory * (end - first);
    s->z = pm_arena_array(&s->arena, (size_t)s->count * ((size_t)s->unroll + 1) * nz, sizeof *s->z);
    s->scale = pm_arena_array(&s->arena, nz, sizeof *s->scale);
    double *state = pm_arena_array(scratch, rows * nz, sizeof *state);
    double *square = pm_arena_array(scratch, nz, sizeof *square);
    if (s->z == NULL || s->scale == NULL || state == NULL || square == NULL) {
        return no_memory();
    }
    const double *row = pm_dataset_state(d, first, 0);
    for (size_t i = 0; i < rows; ++i) {
        pm_columns_to_state(&columns, row + i * (size_t)d->ncolumn, state + i * nz);
    }
    long nsquare = 0;
    cut(s, state, end - first, d->ntime, residual, square, &nsquare);
    pool_scales(s, scene, square, nsquare);
    return PM_OK;
}

pm_status pm_samples_make(pm_samples *samples, const pm_scene *scene, const pm_dataset *dataset,
                          int first, int end, pm_residual residual, int unroll) {
    *samples =
        (pm_samples){.nz = scene->nz, .unroll = residual == PM_RESIDUAL_DERIVATIVE ? 1 : unroll};
    pm_arena scratch = {0};
    const pm_status status = make(samples, scene, dataset, first, end, residual, &scratch);
    pm_arena_free(&scratch);
    if (status != PM_OK) {
        pm_samples_free(samples);
    }
    return status;
}

void pm_samples_free(pm_samples *samples) {
    pm_arena_free(&samples->arena);
}
