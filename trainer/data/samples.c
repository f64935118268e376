// Cuts trajectories into windows of states and boundary inputs, and computes the scales of
// residuals.
#include "data/samples.h"

#include <math.h>
#include <string.h>

// The most states from which a rate is computed. Boundary inputs have kinks between steps, which
// wide differences would smear.
#define WIDEST 9
#define WIDEST_WITH_INPUTS 5
// The error of a rate, relative to the typical rate, from which on its weight falls. The error is
// estimated by a formula of two states less.
#define CERTAIN 3e-4

// The weights of a difference formula: the derivative at node `at` of the polynomial through
// `count` states at unit distances (Fornberg, SIAM Rev. 40 (1998) 685).
typedef struct stencil {
    int count, at;
    double weight[WIDEST];
} stencil;

// The states of a trajectory [first, last] between two jumps of its boundary inputs, across which
// no differences are taken.
typedef struct piece {
    int first, last;
} piece;

// The formula of at most `widest` states for state j of a piece, centred where the piece is long
// enough on both sides.
static stencil stencil_at(int j, piece p, int widest) {
    const int length = p.last - p.first + 1;
    stencil s = {.count = length < widest ? length : widest};
    const int last = p.last + 1 - s.count, middle = j - s.count / 2;
    s.at = j - (middle < p.first ? p.first : middle < last ? middle : last);
    double binomial[WIDEST] = {1}; // barycentric weights of equidistant nodes, with signs
    for (int i = 1; i < s.count; ++i) {
        binomial[i] = -binomial[i - 1] * (s.count - i) / i;
    }
    for (int i = 0; i < s.count; ++i) {
        if (i != s.at) {
            s.weight[i] = binomial[i] / binomial[s.at] / (s.at - i);
            s.weight[s.at] -= s.weight[i];
        }
    }
    return s;
}

// Computes z + dt zdot from the given rates, or by differences if `rate` is NULL.
static void euler_target(const double *state, const double *rate, const stencil *formula, double dt,
                         int nz, double *target) {
    memcpy(target, state, (size_t)nz * sizeof *target);
    for (int c = 0; c < nz && rate != NULL; ++c) {
        target[c] += dt * rate[c];
    }
    for (int i = 0; i < formula->count && rate == NULL; ++i) {
        const double *from = state + (ptrdiff_t)(i - formula->at) * nz;
        for (int c = 0; c < nz; ++c) {
            target[c] += formula->weight[i] * from[c];
        }
    }
}

// The trajectory that is being cut: its states [length][nz], and its rates or NULL.
typedef struct track {
    const double *state, *rate;
    pm_boundary_input input;
    int length, widest;
    int first, end; // the states with which windows begin: [first, end)
} track;

// Finds the states with which windows begin.
static void bound(track *t, const pm_samples *s, const pm_dataset *d, int trajectory,
                  pm_residual residual) {
    t->length = pm_dataset_length(d, trajectory);
    // The states at either end of a trajectory that are no samples, because only one-sided
    // differences could be taken there, and no weight says how inaccurate they are. Short
    // trajectories keep at least half of their states.
    const bool differences = residual == PM_RESIDUAL_DERIVATIVE && d->zdot == NULL && !s->weighted;
    const int most = t->length / 4, half = t->widest / 2;
    t->first = !differences ? 0 : most < half ? most : half;
    // Boundary inputs have no interval after the last state.
    t->end = t->length - (t->first > 0 ? t->first : s->unroll);
    const bool enough = t->end > t->first && (!s->weighted || t->length >= WIDEST);
    t->end = enough ? t->end : t->first;
}

// Cuts one trajectory into windows, and returns the address behind the last one. Where a window has
// room for weights, this function writes estimated errors. Adds the squares of the increments to
// square [nz].
static double *cut(const pm_samples *s, const track *t, const pm_dataset *d, pm_residual residual,
                   double *window, double *square) {
    const size_t nz = (size_t)s->nz,
                 nboundary_input = (size_t)s->input_order * (size_t)s->nboundary_input;
    piece p = {0, s->nboundary_input > 0 ? 0 : t->length - 1};
    for (int j = t->first; j < t->end; ++j) {
        while (j >= p.last && p.last < t->length - 1) {
            p.first = p.last;
            p.last = (int)pm_boundary_input_jump(&t->input, p.first, t->length - 1);
        }
        const double *at = t->state + (size_t)j * nz;
        if (residual == PM_RESIDUAL_DERIVATIVE) {
            memcpy(window, at, nz * sizeof *at);
            // Writes z + dt zdot of state j to target [nz]. If the samples are weighted, the
            // estimated errors are written to error [nz].
            double *target = window + nz;
            double *error = window + pm_samples_weights(s);
            const double *here = t->state + (ptrdiff_t)j * s->nz;
            const stencil wide = stencil_at(j, p, t->widest);
            euler_target(here, t->rate == NULL ? NULL : t->rate + (ptrdiff_t)j * s->nz, &wide,
                         d->dt, s->nz, target);
            if (s->weighted) {
                const stencil less = stencil_at(j, p, t->widest - 2);
                euler_target(here, NULL, &less, d->dt, s->nz, error);
                for (int c = 0; c < s->nz; ++c) {
                    error[c] = fabs(error[c] - target[c]);
                }
            }
        } else {
            memcpy(window, at, ((size_t)s->unroll + 1) * nz * sizeof *at);
        }
        for (int step = 0; step < s->unroll && s->nboundary_input > 0; ++step) {
            memcpy(window + pm_samples_input(s, step),
                   pm_boundary_input_interval(&t->input, j + step), nboundary_input * sizeof *at);
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
    track t = {.widest = s->nboundary_input > 0 ? WIDEST_WITH_INPUTS : WIDEST};
    s->weighted = residual == PM_RESIDUAL_DERIVATIVE && d->zdot == NULL &&
                  s->nboundary_input == 0 && d->ntime >= WIDEST;
    for (int i = first; i < end; ++i) {
        bound(&t, s, d, i, residual);
        s->count += t.end - t.first;
    }
    if (s->count == 0) {
        return pm_fail(PM_EDATA, "%d trajectories of %d states are too short to train on",
                       end - first, d->ntime);
    }
    const size_t nz = (size_t)s->nz, count = (size_t)s->count;
    pm_columns columns;
    PM_TRY(pm_columns_bind(&columns, scene, d, scratch));
    PM_TRY(pm_boundary_input_bind(&t.input, scene, d, 1, scratch));
    s->z = pm_arena_array(&s->arena, count * (size_t)pm_samples_width(s), sizeof *s->z);
    s->scale = pm_arena_array(&s->arena, nz, sizeof *s->scale);
    double *state = pm_arena_array(scratch, (size_t)d->ntime * nz, sizeof *state);
    double *rate = pm_arena_array(scratch, (size_t)d->ntime * nz, sizeof *rate);
    double *square = pm_arena_array(scratch, nz, sizeof *square);
    PM_TRY(pm_arena_status(&s->arena, "training samples"));
    PM_TRY(pm_arena_status(scratch, "training samples"));
    t.state = state;
    t.rate = d->zdot == NULL ? NULL : rate;
    double *window = s->z;
    for (int i = first; i < end; ++i) {
        bound(&t, s, d, i, residual);
        for (int j = 0; j < t.length; ++j) {
            pm_columns_to_state(&columns, pm_dataset_state(d, i, j), state + (size_t)j * nz);
            if (d->zdot != NULL) {
                pm_columns_to_state(&columns, pm_dataset_rate(d, i, j), rate + (size_t)j * nz);
            }
        }
        pm_boundary_input_follow(&t.input, d, i);
        window = cut(s, &t, d, residual, window, square);
    }
    // Every group gets one scale for all components, so that scaled vectors keep their direction.
    for (int part = 0; part < scene->physics.nsubsystem; ++part) {
        const pm_layout *layout = &scene->physics.subsystem[part].layout;
        for (int k = 0; k < layout->ngroup; ++k) {
            const pm_group *group = &layout->group[k];
            const int begin = scene->physics.subsystem[part].first + group->first;
            double sum = 0;
            for (int c = 0; c < group->size; ++c) {
                sum += square[begin + c];
            }
            const double rms = sqrt(sum / ((double)s->count * group->size));
            for (int c = 0; c < group->size; ++c) {
                s->scale[begin + c] = rms > 0 ? rms : 1;
            }
        }
    }
    if (s->weighted) {
        // The estimated errors in all windows become weights. With a weight of one over the
        // error, an uncertain rate still pulls. One-sided differences, whose errors are up to 70
        // times as large as those of central ones, have smaller weights: they count only where
        // rates are certain.
        double *weight = s->z + pm_samples_weights(s);
        const int side = WIDEST / 2;
        for (int i = first; i < end; ++i) {
            bound(&t, s, d, i, residual);
            for (int j = t.first; j < t.end; ++j, weight += pm_samples_width(s)) {
                const bool central = j >= side && j < t.length - side;
                for (int c = 0; c < s->nz; ++c) {
                    const double error = weight[c] / (CERTAIN * s->scale[c]);
                    weight[c] = central ? 1 / hypot(1, error) : 1 / (1 + error * error);
                }
            }
        }
    }
    return PM_OK;
}

pm_status pm_samples_make(pm_samples *samples, const pm_scene *scene, const pm_dataset *dataset,
                          int first, int end, pm_residual residual, int unroll, int input_order) {
    *samples = (pm_samples){.nz = scene->physics.nz,
                            .nboundary_input = scene->physics.nprescribed,
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

void pm_samples_window(const pm_samples *s, int k, double *window) {
    const size_t width = (size_t)pm_samples_width(s);
    memcpy(window, s->z + (size_t)k * width, width * sizeof *window);
}

void pm_samples_free(pm_samples *samples) {
    pm_arena_free(&samples->arena);
}
