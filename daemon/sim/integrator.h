// Runge-Kutta methods as Butcher tableaux, explicit or, by stages that iterate, implicit. One flux
// exchange per stage.
#ifndef PM_SIM_INTEGRATOR_H
#define PM_SIM_INTEGRATOR_H

#include <stdbool.h>

#define PM_MAX_STAGES 16

// k_i = f(z + h sum_j a[i][j] k_j), z' = z + h sum_i b[i] k_i; or else as said below.
typedef struct pm_integrator {
    const char *name;
    int nstage;
    int order; // of convergence
    double a[PM_MAX_STAGES][PM_MAX_STAGES];
    double b[PM_MAX_STAGES]; // all >= 0, so that booked entropy production keeps its sign
    // The method of order `embedded` (0: none) with other weights, b - error_weights, differs by an
    // estimate of the error (step_controller.h).
    int embedded;
    double error_weights[PM_MAX_STAGES];
    // Stages are iterates of the new state z': co-energies are discrete derivatives between z and
    // the iterate, operators and ports are taken at their mean.
    bool discrete;
    // Between two stages the bulk term is integrated by steps of a part's own (multirate.h). A
    // stage begins an interval of the fraction `width` of the step, over which ports give (a[i][j]
    // + slope[i][j] x) k_j, x rising from 0 to 1; b are the weights of the sum of all.
    bool multirate;
    double width[PM_MAX_STAGES], slope[PM_MAX_STAGES][PM_MAX_STAGES];
    // After each step the state is moved, by no more than the method's error, to where energy and
    // entropy have changed by what was booked (projection.h).
    // Training takes the method without that.
    bool balanced;
} pm_integrator;

// When a stage is evaluated, as a fraction of the integrator's step.
double pm_integrator_time(const pm_integrator *rk, int stage);

// The method called `name`, or NULL. _names lists all, separated by ", ".
const pm_integrator *pm_integrator_find(const char *name);
const char *pm_integrator_names(void);

#endif
