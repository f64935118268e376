// Predicts trajectories that a fit has not seen and compares their errors with what the covariance
// of the weights leads to expect.
#include "inference/calibration.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "shooting/continuation.h"

#define FEWEST_HELD 4   // trajectories that replace cross-validation
#define MOST_HELD 24    // trajectories; more tell nothing new
#define MOST_FOLDS 5    // continued fits
#define START_PART 0.1  // of a trajectory, from which its start is estimated
#define ITERATIONS 12   // of a continued fit, at most
#define ENOUGH 1e-3     // it ends when a step lowers the objective by less
#define DAMPING 1e-8    // of its first step: hardly any, as the fit ended near the minimum
#define OUTLIER 6       // deviations of the noise between an outlier and its neighbours
#define NORMAL 1.644854 // 95 % of a normal distribution lie below
#define INSIDE 0.9      // share of the measurements that lie inside their bands
#define GROW 1.02       // factor from one scale that is tried to the next
#define LARGEST 1e8     // scale that is tried

// A measurement of a trajectory that is left out.
typedef struct left_out {
    double error; // square of the error, over that of half the width of a band of deviation 1
    double other; // variance expected from noise and the estimate of the start
    double own;   // variance that the covariance of the weights causes
} left_out;

typedef struct calibration {
    pm_arena arena; // owns the state of the fit
    pm_uncertainty *u;
    pm_shooting *s;
    const pm_calibration_how *how;
    double *weights;   // [nweight] of the fit
    pm_window *window; // [nwindow] of the fit, and their starts [nwindow][nz]
    double *z;
    int nwindow;
    int count;          // trajectories that are compared
    int end[MOST_HELD]; // [count] the samples of trajectory i are sample[end[i - 1]] to end[i] - 1
    left_out *sample;   // [nsample]
    int nsample;
    double *error; // [ny][MOST_HELD] of predicted trajectories
    int npredicted;
} calibration;

// --- one trajectory ---

// The predicted trajectory that is compared with its measurements.
typedef struct comparison {
    const pm_estimate *e;
    const pm_dataset *data;
    int id, trajectory;   // in the estimate and in the data
    int column, position; // in the estimate and in the data
} comparison;

// Returns the error of sample k; NAN: there is none.
static double error_of(const comparison *p, int k) {
    if (k < 0 || k >= p->e->ntime) {
        return NAN;
    }
    return p->e->y[((ptrdiff_t)p->id * p->e->ntime + k) * p->e->ny + p->column] -
           pm_dataset_state(p->data, p->trajectory, k)[p->position];
}

// Notes the errors of a predicted trajectory beside what noise, the estimate of its start and the
// weights lead to expect.
static pm_status compare(calibration *c, const pm_estimate *e, int id, int trajectory,
                         double seconds) {
    const int before = c->nsample, capacity = before + e->ntime * e->ny;
    left_out *sample = realloc(c->sample, (size_t)capacity * sizeof *sample);
    PM_TRY(pm_allocated(sample, "the calibration of bands"));
    c->sample = sample;
    for (int i = 0; i < e->ny; ++i) {
        const comparison p = {.e = e,
                              .data = c->how->data,
                              .id = id,
                              .trajectory = trajectory,
                              .column = i,
                              .position = c->s->observation->column[i]};
        // Notes the samples of one column after the first seconds. Leaves out outliers: samples
        // whose error differs much from the errors of both neighbours.
        const double first = pm_dataset_time(p.data, trajectory, 0);
        const double limit = OUTLIER * c->u->noise[i];
        for (int k = 0; k < e->ntime && c->nsample < capacity; ++k) {
            const double t = pm_dataset_time(p.data, trajectory, k) - first;
            const double whole = error_of(&p, k), error = whole / NORMAL;
            const double rise = whole - error_of(&p, k - 1), fall = whole - error_of(&p, k + 1);
            const bool far_before = !(fabs(rise) <= limit), far_after = !(fabs(fall) <= limit);
            const bool stands_out =
                far_before && far_after && !(rise * fall < 0) && !(isnan(rise) && isnan(fall));
            if (!(t > seconds && t <= e->until) || !isfinite(error) || stands_out) {
                continue;
            }
            const ptrdiff_t at = ((ptrdiff_t)id * e->ntime + k) * e->ny + i;
            const double own = e->by_weights[at], deviation = e->deviation[at];
            const double other = deviation * deviation - c->u->scale * own;
            if (isfinite(other) && own > 0) {
                c->sample[c->nsample++] = (left_out){error * error, fmax(other, 0), own};
            }
        }
    }
    if (c->nsample > before) {
        c->end[c->count++] = c->nsample;
    }
    return PM_OK;
}

// Predicts trajectories with the present weights of the system, as many as may still be compared.
// If the weights cannot follow them, they are left out.
static pm_status predict(calibration *c, int count, const int *trajectory) {
    pm_estimate_how how = {.uncertainty = c->u, .stop = c->how->stop, .until = c->how->until};
    const int left = MOST_HELD - c->count, n = count < left ? count : left;
    for (int i = 0; i < n; ++i) {
        // The seconds that determine the start of a trajectory: as few as there may be in use, but
        // twice as many samples as a start needs.
        const pm_dataset *d = c->how->data;
        const double first = pm_dataset_time(d, trajectory[i], 0);
        const int fewest = pm_continuation_first_length(c->s);
        double length = 0, needed = 0;
        int samples = 0;
        for (int k = 0; k < d->ntime && isfinite(pm_dataset_time(d, trajectory[i], k)); ++k) {
            length = pm_dataset_time(d, trajectory[i], k) - first;
            needed = ++samples <= fewest ? length : needed;
        }
        const double seconds =
            fmax(START_PART * length, fmax(needed, fewest * c->s->how.system->scene->physics.dt));
        how.seconds = fmax(how.seconds, seconds);
    }
    pm_estimate e;
    if (n == 0) {
        return PM_OK;
    }
    pm_status status = pm_estimate_make(&e, c->s->how.system, c->s->observation, c->how->data, n,
                                        trajectory, &how);
    if (status == PM_OK) {
        for (int i = 0; i < n && status == PM_OK; ++i) {
            status = compare(c, &e, i, trajectory[i], how.seconds);
            for (int k = 0; k < e.ny && c->npredicted < MOST_HELD; ++k) {
                c->error[(ptrdiff_t)k * MOST_HELD + c->npredicted] = pm_estimate_error(
                    &e, c->s->observation, c->how->data, trajectory, how.seconds, i, k);
            }
            c->npredicted += c->npredicted < MOST_HELD;
        }
        pm_estimate_free(&e);
    }
    return status == PM_ENUMERIC || status == PM_EDATA ? PM_OK : status;
}

// --- folds ---

static pm_status run_fold(calibration *c, int fold, int nfold) {
    // If its first step hardly lowers the objective, it is the only one.
    pm_shooting_progress progress = {.idle = 1};
    const pm_shooting_limits limits = {.iterations = ITERATIONS,
                                       .enough = ENOUGH,
                                       .work =
                                           c->how->work > 0 ? c->s->work + c->how->work / nfold : 0,
                                       .stop = c->how->stop};
    double damping = DAMPING;
    snprintf(c->s->label, sizeof c->s->label, "bands, fit %d of %d", fold + 1, nfold);
    // Keeps the windows of all trajectories that are not in the fold.
    pm_shooting *s = c->s;
    const size_t nz = (size_t)s->nz;
    s->nwindow = 0;
    for (int w = 0; w < c->nwindow; ++w) {
        if (c->window[w].track % nfold != fold) {
            s->window[s->nwindow] = c->window[w];
            memcpy(s->z + (size_t)s->nwindow++ * nz, c->z + (size_t)w * nz, nz * sizeof *s->z);
        }
    }
    pm_status status = pm_shooting_minimise(c->s, &limits, &damping, &progress);
    int list[MOST_HELD], count = 0;
    for (int i = fold; i < c->s->tracks->count && count < MOST_HELD / MOST_FOLDS + 1; i += nfold) {
        list[count++] = c->how->which[i];
    }
    status = status == PM_OK ? predict(c, count, list) : status;
    // Puts back the windows, starts and weights of the fit.
    const size_t n = (size_t)c->nwindow;
    c->s->nwindow = c->nwindow;
    memcpy(c->s->window, c->window, n * sizeof *c->window);
    memcpy(c->s->z, c->z, n * (size_t)c->s->nz * sizeof *c->z);
    pm_shooting_set_weights(c->s, c->weights);
    return status == PM_ENUMERIC ? PM_OK : status;
}

// --- the whole ---

// Returns by how much the weighted share of measurements inside their bands exceeds INSIDE if the
// bands have this scale.
static double surplus(const calibration *c, double scale) {
    // The sum begins with one trajectory for which the covariance of the weights is right.
    double sum = erf(NORMAL * sqrt(scale / 2)) - INSIDE;
    for (int i = 0, k = 0; i < c->count; ++i) {
        const int first = k;
        double own = 0;
        for (; k < c->end[i]; ++k) {
            const left_out *x = &c->sample[k];
            const double by_weights = scale * x->own, variance = x->other + by_weights;
            own += by_weights / variance * ((x->error <= variance ? 1 : 0) - INSIDE);
        }
        sum += own / (k - first);
    }
    return sum;
}

static pm_status run(calibration *c) {
    const pm_calibration_how *how = c->how;
    if (how->nheld < FEWEST_HELD) {
        const int ntrack = c->s->tracks->count, nfold = ntrack < MOST_FOLDS ? ntrack : MOST_FOLDS;
        const size_t windows = (size_t)c->nwindow;
        c->weights = pm_arena_array(&c->arena, (size_t)c->u->nweight, sizeof *c->weights);
        c->window = pm_arena_array(&c->arena, windows, sizeof *c->window);
        c->z = pm_arena_array(&c->arena, windows * (size_t)c->s->nz, sizeof *c->z);
        PM_TRY(pm_arena_status(&c->arena, "the calibration of bands"));
        pm_shooting_weights(c->s, c->weights);
        memcpy(c->window, c->s->window, windows * sizeof *c->window);
        memcpy(c->z, c->s->z, windows * (size_t)c->s->nz * sizeof *c->z);
        for (int fold = 0; fold < nfold; ++fold) {
            PM_TRY(run_fold(c, fold, nfold));
        }
        return PM_OK;
    }
    return predict(c, how->nheld, how->held);
}

pm_status pm_calibration_make(pm_uncertainty *u, pm_shooting *s, const pm_calibration_how *how) {
    calibration c = {.u = u, .s = s, .how = how, .nwindow = s->nwindow};
    u->scale = 1;
    for (int k = 0; k < u->ny && how->error != NULL; ++k) {
        how->error[k] = NAN;
    }
    if (u->nweight == 0 || (s->tracks->count < 2 && how->nheld < FEWEST_HELD)) {
        return PM_OK;
    }
    c.error = pm_arena_array(&c.arena, (size_t)u->ny * MOST_HELD, sizeof *c.error);
    PM_TRY(pm_arena_status(&c.arena, "the calibration of bands"));
    const clock_t started = clock();
    const pm_status status = run(&c);
    for (int k = 0; k < u->ny && how->error != NULL && c.npredicted > 0; ++k) {
        how->error[k] = pm_box_of(c.npredicted, c.error + (ptrdiff_t)k * MOST_HELD).median;
    }
    if (c.count > 0) {
        printf("bands            %8d prediction%s %8.2f s of CPU   of trajectories that are left "
               "out\n",
               c.count, c.count == 1 ? " " : "s", (double)(clock() - started) / CLOCKS_PER_SEC);
    }
    if (status == PM_OK && c.count > 0) {
        // The quantile of Student's distribution below which 95 % lie, by its expansion in the
        // inverse degrees of freedom (Abramowitz and Stegun, 26.7.5).
        const double freedom = c.count;
        const double z = NORMAL, z3 = z * z * z, z5 = z3 * z * z, z7 = z5 * z * z;
        const double quantile =
            z + (z3 + z) / (4 * freedom) + (5 * z5 + 16 * z3 + 3 * z) / (96 * freedom * freedom) +
            (3 * z7 + 19 * z5 + 17 * z3 - 15 * z) / (384 * freedom * freedom * freedom);
        const double width = quantile / NORMAL;
        // The variance of weights that each trajectory has for itself, with that of their mean in
        // the fit.
        const double own = 1 + s->tracks->count * (1 - 1 / u->inflation);
        // The smallest scale from 1 on at which the share of measurements inside is large enough.
        double scale = 1;
        while (surplus(&c, scale) < 0 && scale < LARGEST) {
            scale *= GROW;
        }
        u->scale = fmax(scale, width * width * own);
    }
    free(c.sample);
    pm_arena_free(&c.arena);
    return status;
}
