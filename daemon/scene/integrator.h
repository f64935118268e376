// Runge-Kutta methods as Butcher tableaux. Every stage needs one exchange of fluxes between
// neighbours. An implicit method appears here as iterations, each of which is a stage. The table
// lies in this layer so that a scene with an unknown integrator is refused when it is read. Adding
// a method means adding one line to the table in integrator.c.
#ifndef PM_SCENE_INTEGRATOR_H
#define PM_SCENE_INTEGRATOR_H

#include <stdbool.h>

#define PM_MAX_STAGES 16

// How a method uses its coefficients.
typedef enum pm_integrator_family {
    PM_RUNGE_KUTTA,
    // The stages are iterates of the new state z'. Co-energies are discrete gradients between z and
    // the iterate; operators and ports are evaluated at the mean of both. A run iterates until all
    // subsystems have converged (sim/iteration.h).
    PM_DISCRETE_GRADIENT
} pm_integrator_family;

// One step of length h from the state z, where f is the right-hand side of README.md, equation (1):
//     k_i = f(z + h sum_j a[i][j] k_j),      z' = z + h sum_i b[i] k_i.
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
    pm_integrator_family family;
    int most_iterations; // of a discrete gradient method in a run; training iterates nstage times
    // After each step the state is moved, by no more than the method's error, to where energy and
    // entropy have changed by the sums of their fluxes (sim/invariant_projection.h). Training uses
    // the method without this projection.
    bool balanced;
} pm_integrator;

// Returns the time at which a stage is evaluated, as a fraction (0 to 1) of the step h.
double pm_integrator_time(const pm_integrator *rk, int stage);

// Returns true if the stages are iterates of the new state.
static inline bool pm_integrator_iterates(const pm_integrator *rk) {
    return rk->family == PM_DISCRETE_GRADIENT;
}
// Returns the largest number of rounds of a substep, each of which exchanges fluxes once.
static inline int pm_integrator_most_rounds(const pm_integrator *rk) {
    return pm_integrator_iterates(rk) ? rk->most_iterations : rk->nstage;
}
// Returns true if the method keeps the energy of a step by construction.
static inline bool pm_integrator_keeps_energy(const pm_integrator *rk) {
    return pm_integrator_iterates(rk) || rk->balanced;
}

// Returns the method with this name, or NULL. It lies in a constant table: nobody frees it.
const pm_integrator *pm_integrator_find(const char *name);
// Returns the names of all methods in the table, separated by ", ".
const char *pm_integrator_names(void);

#endif
