// Computes the sparse Jacobian of an ODE by differences. Components of the state that no rate
// shares have the same colour and are moved together, so that a Jacobian costs one evaluation of
// the rate for each colour (Curtis, Powell, Reid, IMA J. Appl. Math. 13, 1974), however large the
// state is.
#ifndef PM_TRAINER_TRUTH_ODE_JACOBIAN_H
#define PM_TRAINER_TRUTH_ODE_JACOBIAN_H

#include <stdbool.h>

#include "truth/ode.h"

typedef struct pm_ode_jacobian pm_ode_jacobian;

// Finds the colours of the pattern of the ODE, which is borrowed and must have one. Returns NULL if
// memory is exhausted. The caller frees.
pm_ode_jacobian *pm_ode_jacobian_new(const pm_ode *ode);
void pm_ode_jacobian_free(pm_ode_jacobian *jacobian); // NULL is allowed
// Returns the number of colours.
int pm_ode_jacobian_colours(const pm_ode_jacobian *jacobian);

// Where differences are taken, and work space. All arrays are [nz].
typedef struct pm_ode_difference {
    double h;             // s, the present step, from which CVODE derives the smallest difference
    const double *z;      // the state
    const double *zdot;   // its rate
    const double *weight; // one over the tolerated error of each component
    double *moved, *rate; // work space
} pm_ode_difference;

// Writes d zdot / d z to value [start[nz]], in the order of the pattern, with the differences that
// CVODE takes for dense Jacobians. Returns false if a rate is not finite.
bool pm_ode_jacobian_fill(const pm_ode_jacobian *jacobian, const pm_ode_difference *difference,
                          double *value);

#endif
