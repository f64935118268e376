// Loops over the lanes of a batch (batch.h). An array of `rows` x `lanes` numbers has one item in
// each lane; the number of lanes is a multiple of PM_LANES. Every lane is computed in the order in
// which a subsystem alone is computed, so that the bits are the same.
#ifndef PM_SIM_LANES_H
#define PM_SIM_LANES_H

#include <stdint.h>

#include "base/arena.h"
#include "model/training_range.h"

// The sums of a flux (scene/recording.h) for each lane: [lanes] each.
typedef struct pm_lane_flux {
    double *energy, *entropy, *energy_gross, *entropy_gross;
} pm_lane_flux;

// Takes the arrays of a flux from the arena, one after the other from `energy` on. PM_ENOMEM.
pm_status pm_lane_flux_new(pm_lane_flux *flux, pm_arena *arena, int lanes);

// Copies now [rows][lanes] to before. Sets bits of changed [lanes] where a bit of a lane differs.
void pm_lanes_renew(int rows, int lanes, const double *now, double *before, uint64_t *changed);

// to = z + h sum_i weight_i k_i over the first `count` stages, all [rows][lanes]; stage i begins at
// k + i * stride. Sets bits of changed [lanes] where a bit of `to` has changed.
void pm_lanes_combine(int rows, int lanes, int count, const double *weight, double h,
                      const double *z, const double *k, int64_t stride, double *to,
                      uint64_t *changed);

// Does for every lane what pm_flux_book (flux.h) does for a subsystem. e, eta and rate are
// [rows][lanes]; e or eta may be NULL: zero.
void pm_lanes_book(int rows, int lanes, double weight, const double *e, const double *eta,
                   const double *rate, const pm_lane_flux *flux);

// Copies component[c] of the state in each lane: to[c][l] = from[first[l] + component[c] step[l]],
// for `count` components. Sets bits of changed [lanes] where a bit of `to` has changed; changed may
// be NULL.
void pm_lanes_gather(int count, int lanes, const int *component, const double *from,
                     const int *first, const int *step, double *to, uint64_t *changed);

// Sets outside [lanes] to 1 where a group of the state z [layout->nz][lanes] is outside its range
// (model/training_range.h), and to 0 elsewhere.
void pm_lanes_outside(pm_training_range range, int lanes, const double *z, uint64_t *outside);

// Return true if any of the numbers is not zero, or not finite.
int pm_lanes_any(int lanes, const uint64_t *changed);
int pm_lanes_any_not_finite(int64_t count, const double *x);

#endif
