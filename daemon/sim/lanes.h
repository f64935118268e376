// Loops over the lanes of a batch (batch.h). An array [rows][lanes] has one item in each lane; the
// number of lanes is a multiple of PM_LANES. The operations on one lane have the order in which a
// subsystem alone is computed, so that the bits are the same.
//
// Functions with an argument changed [lanes] report where they have overwritten a number by one
// with other bits: they set at least one bit of changed[l] if any number of lane l has changed, and
// never clear a bit.
#ifndef PM_SIM_LANES_H
#define PM_SIM_LANES_H

#include <stdint.h>

#include "base/arena.h"
#include "model/training_range.h"

// The parts of a flux (pm_flux in scene/recording.h) for each lane: [lanes] each, energy in W and
// entropy in W/K. The arena owns the arrays.
typedef struct pm_lane_flux {
    double *energy, *entropy, *energy_gross, *entropy_gross;
} pm_lane_flux;

// Takes the four arrays of a flux, zeroed, from the arena. They lie one after the other in memory
// and begin with `energy`. PM_ENOMEM.
pm_status pm_lane_flux_new(pm_lane_flux *flux, pm_arena *arena, int lanes);

// Copies now [rows][lanes] to before [rows][lanes]. Reports in `changed` the lanes in which the two
// differed.
void pm_lanes_renew(int rows, int lanes, const double *now, double *before, uint64_t *changed);

// Computes to = z + h sum_i weight_i k_i over the first `count` stages, a combination of a
// Runge-Kutta method with substeps of h s. `to`, `z` and each k_i are [rows][lanes]; k_i begins at
// k + i * stride. Reports in `changed` the lanes in which `to` has changed.
void pm_lanes_combine(int rows, int lanes, int count, const double *weight, double h,
                      const double *z, const double *k, int64_t stride, double *to,
                      uint64_t *changed);

// Adds to the flux of every lane weight e.rate (energy) and weight eta.rate (entropy), and to its
// gross fluxes the same sums of magnitudes, as pm_flux_book (flux.h) does for one subsystem. The
// co-energies e, eta and the rate are [rows][lanes]; NULL stands for zero in e or eta.
void pm_lanes_book(int rows, int lanes, double weight, const double *e, const double *eta,
                   const double *rate, const pm_lane_flux *flux);

// Copies the components component [count] of the state in each lane:
//     to[c][l] = from[first[l] + component[c] step[l]]
// first and step are [lanes], `to` is [count][lanes]. Reports in `changed` the lanes in which `to`
// has changed; `changed` may be NULL.
void pm_lanes_gather(int count, int lanes, const int *component, const double *from,
                     const int *first, const int *step, double *to, uint64_t *changed);

// Sets outside [lanes] to 1 where a group of the state z [layout->nz][lanes] is outside its
// training range (model/training_range.h), and to 0 elsewhere.
void pm_lanes_outside(pm_training_range range, int lanes, const double *z, uint64_t *outside);

// pm_lanes_any returns 1 if any number of changed [lanes] is not zero, and
// pm_lanes_any_not_finite if any number of x [count] is not finite. Otherwise they return 0.
int pm_lanes_any(int lanes, const uint64_t *changed);
int pm_lanes_any_not_finite(int64_t count, const double *x);

#endif
