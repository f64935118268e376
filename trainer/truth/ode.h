// Solves initial value problems zdot = f(z) with SUNDIALS CVODE (Hindmarsh et al., ACM Trans. Math.
// Softw. 31, 2005) and samples the solution at equal intervals. No other file uses SUNDIALS.
#ifndef PM_TRAINER_TRUTH_ODE_H
#define PM_TRAINER_TRUTH_ODE_H

#include <stdbool.h>

#include "base/status.h"

// Computes zdot [nz] at the state z [nz].
typedef void (*pm_ode_rate)(const void *data, const double *z, double *zdot);

// The rates that depend on each component of the state: those of component j are row[start[j]] to
// row[start[j + 1] - 1], in ascending order, and j is always among them.
typedef struct pm_ode_pattern {
    const int *start; // [nz + 1]
    const int *row;   // [start[nz]]
} pm_ode_pattern;

typedef struct pm_ode {
    int nz;
    pm_ode_rate rate;
    const void *data;              // passed to `rate`
    const pm_ode_pattern *pattern; // borrowed; NULL: any rate may depend on any component
} pm_ode;

// adams: orders 1-12 with fixed-point iteration. bdf: orders 1-5 with Newton's method and a
// Jacobian by differences, for stiff problems. The Jacobian is dense, or sparse where the ODE has a
// pattern.
typedef enum pm_ode_family { PM_ODE_ADAMS, PM_ODE_BDF } pm_ode_family;

// The local error of a step is kept below relative |z_i| + absolute, in the root mean square over
// the components i.
typedef struct pm_ode_method {
    pm_ode_family family;
    double relative, absolute;
} pm_ode_method;

// Fills z [ntime][nz] with the solution every dt s. Its first row is the initial state, which the
// caller provides. PM_ENUMERIC (the error tells the time reached), PM_ENOMEM.
pm_status pm_ode_solve(const pm_ode *ode, pm_ode_method method, int ntime, double dt, double *z);

// --- sparse Jacobians ---

// Computes the sparse Jacobian of an ODE by differences. Components of the state that no rate
// shares have the same colour and are moved together, so that a Jacobian costs one evaluation of
// the rate for each colour (Curtis, Powell, Reid, IMA J. Appl. Math. 13, 1974), however large the
// state is.
typedef struct pm_ode_jacobian pm_ode_jacobian;

// Finds the colours of the pattern of the ODE, which is borrowed and must have one. Returns NULL if
// memory is exhausted. The caller frees.
pm_ode_jacobian *pm_ode_jacobian_new(const pm_ode *ode);
void pm_ode_jacobian_free(pm_ode_jacobian *jacobian); // NULL is allowed

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
