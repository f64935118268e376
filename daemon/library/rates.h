// Compiles the rates of a whole scene into one program (graph/program.h), which evaluates many
// copies of the scene at once. Each copy is a lane of the arrays [numbers][lanes]. The results have
// the bits of the engine's. Three further programs multiply the Jacobian of the rates from the
// left, multiply it from the right, and compute energies and entropies. They serve explicit methods
// that neither estimate their error nor balance the energy.
#ifndef PM_LIBRARY_RATES_H
#define PM_LIBRARY_RATES_H

#include <stddef.h>

#include "base/lanes.h"
#include "graph/program.h"
#include "library/setup.h"

// More copies at a time would drive the numbers of a program out of the cache.
#define PM_RATES_LANES 32

// Returns the number of lanes for so many copies.
static inline int pm_rates_lanes(int64_t count) {
    return count == 1               ? 1
           : count > PM_RATES_LANES ? PM_RATES_LANES
                                    : ((int)count + PM_LANES - 1) / PM_LANES * PM_LANES;
}

// A task is what a program computes at a state z with the inputs u.
typedef enum pm_rates_task {
    PM_RATES,      // k(z, u, weights)
    PM_ADJOINT,    // k_z^T seed, k_u^T seed, k_weights^T seed
    PM_TANGENT,    // k, and k_z dz + k_u du + k_weights dw
    PM_POTENTIALS, // E and S of each subsystem, J and J/K
    PM_RATES_TASKS
} pm_rates_task;

// NULL: nothing depends on an input, or a result is zero, or it is one of another task.
typedef struct pm_rates {
    pm_program *program; // NULL: the graph cannot be run in lanes
    pm_arena arena;
    int nmatrix;
    double *z, *u, *seed, *dz, *du, **dw; // inputs; dw [nmatrix]
    const double *k, *dk, *E, *S;         // results
    const double *by_z, *by_u, **by_w;    // results; by_w [nmatrix]
    const double *shown; // the `held` of the copies whose inputs u has; set it to NULL for others
} pm_rates;

// Opens a program for so many lanes, 1 or a multiple of PM_LANES. matrix [nmatrix] are the weights
// by which it differentiates. It is compiled if the system asks for it. The caller closes, on
// failure too. Fails as pm_program_open and pm_compiler_link do.
pm_status pm_rates_open(pm_rates *rates, const pm_system *system, pm_rates_task task, int lanes,
                        int nmatrix, const pm_param_entry *const *matrix);
void pm_rates_close(pm_rates *rates);

// Copies in lanes. Lanes behind the last copy repeat it.
typedef struct pm_copies {
    const pm_setup *setup;
    int lanes, used;
    const int64_t *copy; // [used] rows of arrays of copies
    const int64_t *step; // [copies] steps that each has taken
    const double *held;  // [copies][nprescribed] values of inputs, NaN: the scene's
    double *row;         // [nprescribed] work space, as is changed [lanes]
    uint64_t *changed;
} pm_copies;

// Copy rows [n] of arrays of copies to to [n][lanes], and back; a NULL `from` gives zeros.
void pm_copies_gather(const pm_copies *c, int n, const double *from, double *to);
void pm_copies_scatter(const pm_copies *c, int n, const double *from, double *to);

// Runs a program at the states z [nz][lanes] of a stage of substep number `substep`, counted from
// the copies' present steps on.
void pm_rates_run(pm_rates *r, const pm_copies *c, int64_t substep, int stage, const double *z);
// Computes to = z + h sum_i weight_i k_i for states k [count], which may be z itself.
void pm_copies_combine(const pm_copies *c, int count, const double *weight, double h,
                       const double *z, const double *k, double *to);
// Takes a substep from z to z with a program of rates. Writes the rates of the stages to k [nstage]
// and their states to places that are `apart` numbers apart, 0 or more, from `stage` on.
void pm_rates_substep(pm_rates *r, const pm_copies *c, int64_t substep, double *z, double *k,
                      double *stage, ptrdiff_t apart);

#endif
