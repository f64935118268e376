// Levenberg and Marquardt's iteration for least squares (Marquardt, J. SIAM 11 (1963) 431), apart
// from the problem that it solves. An iteration linearises the residuals, then raises the damping
// until a step lowers the objective. It then lowers the damping for the next iteration.
#ifndef PM_TRAINER_OPTIMISE_LEVENBERG_MARQUARDT_H
#define PM_TRAINER_OPTIMISE_LEVENBERG_MARQUARDT_H

#include <stdbool.h>

#include "base/status.h"

// A problem. The unknowns, the step and the trial point belong to the caller, behind `context`.
typedef struct pm_levenberg_marquardt_problem {
    // Returns true if no further iteration is wanted.
    bool (*is_over)(void *context);
    // Linearises the residuals at the unknowns, and writes the objective there.
    pm_status (*linearise)(void *context, double *objective);
    // Computes the step with this damping. Returns false if the equations are singular.
    bool (*solve)(void *context, double damping);
    // Evaluates the objective after the step, or after a part of it. Writes to *fraction which part
    // of the step has lowered the objective from `before` to *after: 1 for all of it, 0 for none.
    pm_status (*evaluate)(void *context, double before, double *after, double *fraction);
    // Ends an iteration. With `moved` the last trial point becomes the unknowns; otherwise no
    // damping has lowered the objective, the unknowns stay as they are, and *after is *before.
    pm_status (*finish)(void *context, double before, double after, bool moved);
    void *context;
} pm_levenberg_marquardt_problem;

// The damping, in units of the diagonal of the normal equations.
typedef struct pm_damping {
    double first;    // at the beginning, and again after an iteration without a step
    double smallest; // it does not fall below this
    double largest;  // with a larger one no step is tried
    double relax;    // its factor after a whole step
    double stiffen;  // its factor after a step that was shortened or refused
} pm_damping;

// Iterates until the problem is over. *damping is 0 at first, and carries over to the next call.
// Fails as the functions of the problem do.
pm_status pm_levenberg_marquardt(const pm_levenberg_marquardt_problem *problem,
                                 const pm_damping *how, double *damping);

#endif
