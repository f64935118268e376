// Projection of the state onto the energy and entropy that follow from the fluxes. After a step of
// an explicit method two amounts differ by the method's error: the change of the subsystem's
// energy, and the energy that flowed in, h sum_i b_i dE(z_i) . k_i. The projection moves the state,
// by no more than the method's error, to where the two agree. The flux that leaves one subsystem
// enters its neighbour at every stage. Each subsystem on its own, without another exchange,
// therefore keeps the total energy to rounding. The entropy is treated alike, so that it never
// falls.
//
// The method is projection onto invariants (Hairer, Lubich, Wanner, Geometric Numerical
// Integration, section IV.4). The invariants are energy less the integral of its flux, and entropy
// less the integral of its rate. Distances are measured, for each group of variables, by how far it
// moved during the step.
#ifndef PM_SIM_INVARIANT_PROJECTION_H
#define PM_SIM_INVARIANT_PROJECTION_H

#include <stdbool.h>

#include "model/spec.h"

// The totals: the energy and entropy that a subsystem must have. They are summed up from its start
// on, so that the next step also corrects the difference that remains after a step. The gross
// values sum the magnitudes of the totals at the start of the step and of the terms of the step.
// They are the scale of rounding.
typedef struct pm_invariant_projection {
    double energy, energy_gross;   // J
    double entropy, entropy_gross; // J/K
} pm_invariant_projection;

// Starts from the energy (J) and entropy (J/K) that the subsystem has.
void pm_invariant_projection_start(pm_invariant_projection *projection, double E, double S);

// Adds the contribution of one stage to the totals: weight * dE . k to the energy, and
// weight * dS . k to the entropy. The weight is h b_i (s); dE, dS and k are [n], and k is the
// stage's rate. dE or dS may be NULL: zero. `first` marks the first stage of a step.
void pm_invariant_projection_book(pm_invariant_projection *projection, bool first, double weight,
                                  int n, const double *dE, const double *dS, const double *k);

// Performs one iteration of Newton's method. It moves z [layout->nz], the state after a step from
// `start` [layout->nz], so that its energy and entropy approach the totals. E (J), S (J/K), dE and
// dS [layout->nz] are the values at z; dE or dS may be NULL: zero. Returns true if it moved z.
//
// Returns false and leaves z as it is in two cases:
// - E and S agree with the totals to rounding, or dE is NULL.
// - Only a move longer than the step itself would reach the totals, or none at all. This happens
//   where dE and dS are parallel, when the step did not move the state, and when the step is far
//   too long. The totals are then set to E and S, so that later steps do not correct this
//   difference. The ledger of the run shows it as a change of the total energy or entropy.
bool pm_invariant_projection_newton_step(pm_invariant_projection *projection,
                                         const pm_layout *layout, const double *start, double E,
                                         double S, const double *dE, const double *dS, double *z);

#endif
