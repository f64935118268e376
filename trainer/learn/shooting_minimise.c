// Levenberg-Marquardt steps of multiple shooting.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "learn/shooting.h"

#define FIRST_DAMPING 1e-2
#define SMALLEST_DAMPING 1e-10
#define LARGEST_DAMPING 1e10
#define RELAX 0.2 // factor of the damping after a step that lowered the objective
#define STIFFEN 5 // and after one that did not

void pm_shooting_weights(const pm_shooting *s, double *theta) {
    for (int i = 0; i < pm_system_components(s->how.system) && s->nweight > 0; ++i) {
        const pm_params *params = pm_system_params(s->how.system, i);
        pm_params_gather(params, theta);
        theta += pm_params_trained(params);
    }
}

void pm_shooting_set_weights(const pm_shooting *s, const double *theta) {
    for (int i = 0; i < pm_system_components(s->how.system) && s->nweight > 0; ++i) {
        pm_params *params = pm_system_params(s->how.system, i);
        pm_params_scatter(params, theta);
        theta += pm_params_trained(params);
    }
}

// Weights and starts, [nweight + nwindow * nz] each.
typedef struct descent {
    double *kept, *step, *trial;
} descent;

static void write_point(const pm_shooting *s, const double *point) {
    pm_shooting_set_weights(s, point);
    memcpy(s->z, point + s->nweight, (size_t)s->nwindow * (size_t)s->nz * sizeof *s->z);
}

// Makes one step. Returns false if no damping lowers the objective.
static bool step(pm_shooting *s, const descent *x, double *damping, double *objective) {
    const size_t n = (size_t)s->nweight + (size_t)s->nwindow * (size_t)s->nz;
    while (*damping < LARGEST_DAMPING) {
        if (pm_shooting_solve(s, *damping, x->step, x->step + s->nweight)) {
            for (size_t i = 0; i < n; ++i) {
                x->trial[i] = x->kept[i] + x->step[i];
            }
            pm_shooting_set_weights(s, x->trial);
            const double after = pm_shooting_evaluate(s, x->trial + s->nweight, false);
            if (after < *objective) {
                memcpy(x->kept, x->trial, n * sizeof *x->kept);
                write_point(s, x->kept);
                *objective = after;
                *damping = fmax(*damping * RELAX, SMALLEST_DAMPING);
                return true;
            }
        }
        *damping *= STIFFEN;
    }
    write_point(s, x->kept);
    *damping = FIRST_DAMPING;
    return false;
}

static pm_status minimise(pm_shooting *s, const descent *x, const pm_shooting_limits *limits,
                          double *damping, pm_shooting_progress *progress) {
    pm_shooting_weights(s, x->kept);
    memcpy(x->kept + s->nweight, s->z, (size_t)s->nwindow * (size_t)s->nz * sizeof *s->z);
    *damping = *damping == 0 ? FIRST_DAMPING : *damping;
    while (progress->iterations < limits->iterations && progress->idle < 2) {
        PM_TRY(limits->keep == NULL ? PM_OK : limits->keep(limits->context, progress));
        double now = pm_shooting_evaluate(s, s->z, true);
        if (!isfinite(now)) {
            PM_TRY(s->failed);
            return pm_fail(PM_ENUMERIC, "multiple shooting: the objective is %g", now);
        }
        const double before = now;
        progress->before = progress->iterations == 0 ? now : progress->before;
        const bool moved = step(s, x, damping, &now);
        ++progress->iterations;
        progress->after = now;
        if (limits->stop != NULL && *limits->stop) {
            return pm_fail(PM_EINTERRUPTED, "interrupted");
        }
        if (!moved) {
            break;
        }
        progress->idle = now > before * (1 - limits->enough) ? progress->idle + 1 : 0;
    }
    // Residuals and ends of windows are those of the result.
    pm_shooting_evaluate(s, s->z, false);
    return s->failed;
}

pm_status pm_shooting_minimise(pm_shooting *s, const pm_shooting_limits *limits, double *damping,
                               pm_shooting_progress *progress) {
    const size_t n = (size_t)s->nweight + (size_t)s->nwindow * (size_t)s->nz;
    const descent x = {malloc(n * sizeof(double)), malloc(n * sizeof(double)),
                       malloc(n * sizeof(double))};
    const pm_status status = x.kept == NULL || x.step == NULL || x.trial == NULL
                                 ? pm_fail(PM_ENOMEM, "out of memory for multiple shooting")
                                 : minimise(s, &x, limits, damping, progress);
    free(x.kept);
    free(x.step);
    free(x.trial);
    return status;
}
