// Projection onto the booked energy and entropy. After a step of an explicit method the energy of a
// subsystem differs from the energy that flowed in, h sum_i b_i dE(z_i) . k_i, by the method's
// error. The projection moves the state to where its energy has changed by exactly the booked
// amount; it moves it by no more than the method's error. Since the flux that leaves one subsystem
// enters its neighbour at every stage, the total energy is then kept to rounding, by each subsystem
// on its own and without another exchange. The entropy is treated alike, so that it never falls.
//
// The method is projection onto invariants (Hairer, Lubich, Wanner, Geometric Numerical
// Integration, section IV.4); the invariants are those of the state together with the books.
// Distances are measured, for each group of variables, by how far it moved during the step.
#ifndef PM_SIM_INVARIANT_PROJECTION_H
#define PM_SIM_INVARIANT_PROJECTION_H

#include <stdbool.h>

#include "model/spec.h"

// The energy and entropy that a subsystem must have. They are summed up from its start on, so that
// the next step corrects what one step leaves (rounding, at least). The gross values sum the
// magnitudes booked during the step, the scale of rounding.
typedef struct pm_invariant_projection {
    double energy, energy_gross;   // J
    double entropy, entropy_gross; // J/K
} pm_invariant_projection;

// Starts from the energy (J) and entropy (J/K) that the subsystem has.
void pm_invariant_projection_start(pm_invariant_projection *projection, double E, double S);

// Books one stage: adds weight dE . k and weight dS . k, where the weight is h b_i (s), dE, dS and
// k are [n], and k is the stage's rate. dE or dS may be NULL: zero. `first` marks the first stage
// of a step.
void pm_invariant_projection_book(pm_invariant_projection *projection, bool first, double weight,
                                  int n, const double *dE, const double *dS, const double *k);

// Takes one step of Newton's method: moves z [layout->nz], the state after a step from `start`
// [layout->nz], given E, S, dE, dS at z (dE, dS may be NULL: zero). Returns false, and leaves z, if
// z has the booked values, or if no move shorter than the step itself reaches them (as when energy
// and entropy depend on the state alike, at rest, or when the step is far too long). In the latter
// case the difference is written off, so that later steps do not correct what is not theirs; the
// totals in the ledger show it.
bool pm_invariant_projection_move(pm_invariant_projection *projection, const pm_layout *layout,
                                  const double *start, double E, double S, const double *dE,
                                  const double *dS, double *z);

#endif
