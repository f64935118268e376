// Derivatives of rollouts of copies, by reverse and forward accumulation. A rollout takes every
// copy of a fleet from a start through `pieces` times `steps` steps, with inputs that hold during a
// piece; its results are the states at the ends of all pieces. The derivatives are those of the
// discrete steps: the adjoints of the graphs of the rates, and those of the Runge-Kutta method.
//
// The reverse pass needs the states of all stages. They are computed twice: once to keep a state of
// every c-th substep, and then c substeps at a time, so that memory grows with the square root of
// the number of substeps.
#ifndef PM_LIBRARY_FLEET_GRADIENT_H
#define PM_LIBRARY_FLEET_GRADIENT_H

#include "library/fleet.h"

typedef struct pm_fleet_gradient pm_fleet_gradient;

typedef struct pm_fleet_rollout {
    int64_t pieces, steps;
    const double *start; // [count][nz]; NULL: the present states of the fleet
    const double *input; // [pieces][count][nprescribed] as in pm_fleet; NULL: the fleet's, always
} pm_fleet_rollout;

// Returns the number of weights of a system: all numbers that training may change, subsystem by
// subsystem, then port by port, without those that another component owns.
int pm_fleet_weights(const pm_system *system);
// Lists the names of their `count` matrices, with the shapes: "upper.constant.K[1][1]". The arena
// owns them. PM_ENOMEM.
pm_status pm_fleet_weight_names(const pm_system *system, int *count, const char ***names,
                                pm_arena *arena);

// Computes the gradient of the sum of seed [pieces][count][nz] times all results of a rollout, for
// each copy: by_start [count][nz], by_input [pieces][count][nprescribed], where a value of the
// scene that no number replaces counts as one that is shifted during the piece, and by_weight
// [count][pm_fleet_weights]. The last two may be NULL. Copies that have ended take part, too. The
// fleet stays as it is, but keeps programs and their memory. PM_EUSAGE: a number is out of range.
// PM_ECONFIG: the integrator is none of euler, heun, rk4 and rk6, or has a tolerance. PM_ENOMEM.
pm_status pm_fleet_vjp(pm_fleet *fleet, const pm_fleet_rollout *rollout, const double *seed,
                       double *by_start, double *by_input, double *by_weight);
// Computes the states at the ends of all pieces z [pieces][count][nz], and their derivatives dz of
// this shape along directions of start, inputs and weights, in the shapes above; NULL: zero. Fails
// as pm_fleet_vjp does.
pm_status pm_fleet_jvp(pm_fleet *fleet, const pm_fleet_rollout *rollout, const double *d_start,
                       const double *d_input, const double *d_weight, double *z, double *dz);

#endif
