// Runge-Kutta methods as Butcher tableaux. Every stage needs one exchange of fluxes between
// neighbours. An implicit method appears here as iterations, each of which is a stage. The table
// lies in this layer so that a scene with an unknown integrator is refused when it is read. Adding
// a method means adding one line to the table in integrator.c.
#ifndef PM_SCENE_INTEGRATOR_H
#define PM_SCENE_INTEGRATOR_H

#include <stdbool.h>

#define PM_MAX_STAGES 16

// One step of length h from the state z, where f is the right-hand side of README.md, equation (1):
//     k_i = f(z + h sum_j a[i][j] k_j),      z' = z + h sum_i b[i] k_i.
// The members `discrete` and `multirate` mark methods that use the coefficients differently.
typedef struct pm_integrator {
    const char *name;
    int nstage;
    int order; // of convergence: the global error falls like h^order
    double a[PM_MAX_STAGES][PM_MAX_STAGES];
    double b[PM_MAX_STAGES]; // all >= 0, so that the summed entropy production keeps its sign
    // A second method with the weights b - error_weights has the order `embedded` (0: there is
    // none). The difference of both results estimates the error (sim/step_controller.h).
    int embedded;
    double error_weights[PM_MAX_STAGES];
    // The stages are iterates of the new state z'. Co-energies are discrete gradients between z and
    // the iterate; operators and ports are evaluated at the mean of both. A run iterates until all
    // subsystems have converged (sim/iteration.h), at most `most_iterations` times. Training
    // iterates nstage times.
    bool discrete;
    int most_iterations;
    // A stage begins an interval of length width[i] h. Within it each subsystem integrates its bulk
    // term with substeps of its own (sim/multirate.h), while its ports contribute the rate
    //     sum_j (a[i][j] + slope[i][j] x) k_j / width[i],
    // where x rises from 0 to 1. Each b[j] is the sum of a[i][j] + slope[i][j]/2 over all i.
    bool multirate;
    double width[PM_MAX_STAGES], slope[PM_MAX_STAGES][PM_MAX_STAGES];
    // After each step the state is moved, by no more than the method's error, to where energy and
    // entropy have changed by the sums of their fluxes (sim/invariant_projection.h). Training uses
    // the method without this projection.
    bool balanced;
} pm_integrator;

// Returns the time at which a stage is evaluated, as a fraction (0 to 1) of the step h.
double pm_integrator_time(const pm_integrator *rk, int stage);

// Returns the method with this name, or NULL. It lies in a constant table: nobody frees it.
const pm_integrator *pm_integrator_find(const char *name);
// Returns the names of all methods in the table, separated by ", ".
const char *pm_integrator_names(void);

#endif
