// Loops over the lanes of a block (engine.h). An array [rows][lanes] has one item in each lane; the
// number of lanes is 1 or a multiple of PM_LANES. The operations on one lane have the same order
// for any number of lanes, so that the bits are the same.
//
// Functions with an argument renewed [lanes] report which numbers have got other bits: they set bit
// r % 64 of renewed[l] if number r of lane l has, and clear all other bits.
#ifndef PM_SIM_LANES_H
#define PM_SIM_LANES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/arena.h"
#include "model/training_range.h"
#include "scene/recording.h"

// The parts of a flux (pm_flux in scene/recording.h) for each lane: [lanes] each, energy in W and
// entropy in W/K. The arena owns the arrays.
typedef struct pm_lane_flux {
    double *energy, *entropy, *energy_gross, *entropy_gross;
} pm_lane_flux;

// Returns the flux of one lane.
static inline pm_flux pm_lane_flux_at(const pm_lane_flux *flux, int lane) {
    return (pm_flux){flux->energy[lane], flux->entropy[lane], flux->energy_gross[lane],
                     flux->entropy_gross[lane]};
}

// Returns a flux as that of a single lane. The arrays are borrowed from it.
static inline pm_lane_flux pm_lane_flux_of(pm_flux *flux) {
    return (pm_lane_flux){&flux->energy, &flux->entropy, &flux->energy_gross, &flux->entropy_gross};
}

// Returns the fluxes from lane number `lane` on. The arrays are borrowed.
static inline pm_lane_flux pm_lane_flux_from(const pm_lane_flux *flux, int64_t lane) {
    return (pm_lane_flux){flux->energy + lane, flux->entropy + lane, flux->energy_gross + lane,
                          flux->entropy_gross + lane};
}

// Takes the four arrays of a flux, zeroed, from the arena. They lie one after the other in memory
// and begin with `energy`. PM_ENOMEM.
pm_status pm_lane_flux_new(pm_lane_flux *flux, pm_arena *arena, int lanes);

// Copies `from` [n] to `to` [n]. Returns true if this changed any bit of `to`: 0 and -0 differ. If
// either array is NULL, it copies nothing and returns false.
bool pm_renew(double *to, const double *from, int n);

// Copies now [rows][lanes] to before [rows][lanes]. Reports in `renewed` where the two differed.
void pm_lanes_renew(int rows, int lanes, const double *now, double *before, uint64_t *renewed);

// Computes to = z + h sum_i weight_i k_i over the first `count` stages, a combination of a
// Runge-Kutta method with substeps of h s. All states and each k_i are [rows][lanes]; k_i begins at
// k + i * stride. Reports in `renewed` where `to` differs from `before`, which may be `to` itself.
void pm_lanes_combine(int rows, int lanes, int count, const double *weight, double h,
                      const double *z, const double *k, int64_t stride, const double *before,
                      double *to, uint64_t *renewed);

// Adds to the flux of every lane weight e.rate (energy) and weight eta.rate (entropy), and to its
// gross fluxes the same sums of magnitudes. If `anew` is true, the fluxes are zero before, whatever
// the arrays hold. The co-energies e, eta and the rate are [rows][lanes]; NULL stands for zero in
// eta. The weight must not be negative.
void pm_lanes_book(int rows, int lanes, double weight, bool anew, const double *e,
                   const double *eta, const double *rate, const pm_lane_flux *flux);

// The places of PM_LANES items to which neighbouring lanes refer. The items lie in arrays of
// [rows][lanes] of their own.
typedef struct pm_lane_row {
    int first, step; // of the first item: where its numbers begin, and their distance
    int lane;        // its lane, counted through all blocks of all arrays
    bool neighbours; // all items lie beside each other, the first one first
} pm_lane_row;

// The places of the items to which the lanes of a block refer.
typedef struct pm_lane_places {
    const pm_lane_row *row;         // [lanes / PM_LANES]; unused for one lane
    const int *first, *step, *lane; // [lanes] the same for each item
} pm_lane_places;

// Notes in row [lanes / PM_LANES] what the arrays `first`, `step` and `lane` of `places` say.
void pm_lanes_note_rows(int lanes, const pm_lane_places *places, pm_lane_row *row);

// Copies the components component [count] of the item of each lane:
//     to[c][l] = from[first[l] + component[c] step[l]]
// `to` is [count][lanes]. Here and below, the function whose name ends with _block serves more than
// one lane.
void pm_lanes_gather_block(int count, int lanes, const int *component, const pm_lane_places *places,
                           const double *from, double *to);
static inline void pm_lanes_gather(int count, int lanes, const int *component,
                                   const pm_lane_places *places, const double *from, double *to) {
    if (lanes > 1) {
        pm_lanes_gather_block(count, lanes, component, places, from, to);
        return;
    }
    const double *item = from + places->first[0];
    for (int c = 0; c < count; ++c) {
        to[c] = item[(ptrdiff_t)component[c] * places->step[0]];
    }
}
// Sets bits of renewed [lanes] where the item of a lane has a bit that is in `wanted`, too:
//     renewed[l] |= from[lane[l]] & wanted
void pm_lanes_gather_renewed_block(int lanes, const pm_lane_places *places, const uint64_t *from,
                                   uint64_t wanted, uint64_t *renewed);
static inline void pm_lanes_gather_renewed(int lanes, const pm_lane_places *places,
                                           const uint64_t *from, uint64_t wanted,
                                           uint64_t *renewed) {
    if (lanes > 1) {
        pm_lanes_gather_renewed_block(lanes, places, from, wanted, renewed);
        return;
    }
    renewed[0] |= from[places->lane[0]] & wanted;
}
// Adds rate [count][lanes] to the items of the lanes from number `begin` to number `end` - 1, one
// lane after the other:
//     to[first[l] + component[c] step[l]] += rate[c][l]
void pm_lanes_add(int count, int lanes, const int *component, const pm_lane_places *places,
                  int begin, int end, const double *rate, double *to);

// Sets outside [lanes] to 1 where a group of the state z [layout->nz][lanes] is outside its
// training range, as pm_training_range_departure says, and to 0 elsewhere.
void pm_lanes_outside(pm_training_range range, int lanes, const double *z, uint64_t *outside);

// pm_lanes_any returns 1 if any number of x [lanes] is not zero, pm_lanes_all if no number is zero,
// and pm_lanes_any_not_finite if any number of x [count] is not finite. Otherwise they return 0.
int pm_lanes_any_block(int lanes, const uint64_t *x);
int pm_lanes_all_block(int lanes, const uint64_t *x);
static inline int pm_lanes_any(int lanes, const uint64_t *x) {
    return lanes > 1 ? pm_lanes_any_block(lanes, x) : x[0] != 0;
}
static inline int pm_lanes_all(int lanes, const uint64_t *x) {
    return lanes > 1 ? pm_lanes_all_block(lanes, x) : x[0] != 0;
}
int pm_lanes_any_not_finite(int64_t count, const double *x);

// Returns the largest of the numbers x [count], which are not negative; 0 if there is none.
double pm_lanes_largest(int count, const double *x);
// Computes for each of `nclass` classes the largest residual of the lanes whose gross flux
// max(gross_a, gross_b) is at least least[class]: |a + b| / gross if `magnitude` is true, else
// -(a + b) / gross. A class without a positive residual has 0. All arrays are [lanes], with any
// number of lanes; b and gross_b may be NULL: zero. least and worst are [nclass], and nclass is at
// most PM_LANES_CLASSES.
#define PM_LANES_CLASSES 8
void pm_lanes_worst(int lanes, bool magnitude, const double *a, const double *b,
                    const double *gross_a, const double *gross_b, int nclass, const double *least,
                    double *worst);

#endif
