// Energy and entropy of a part after a step of an explicit method, brought to what was booked. What
// flows in, h sum_i b_i dE(z_i) . k_i, is a quadrature of the method's own order, and what leaves
// one part enters the other at every stage. So a state that is moved to where its energy has
// changed by exactly that differs from the method's by no more than the method's error, and the
// total energy is kept to rounding, by each part on its own and without another exchange. Likewise
// the entropy, which then never falls, whatever function of the state it is.
//
// This is projection onto invariants (Hairer, Lubich, Wanner, Geometric Numerical Integration,
// section IV.4), the invariants being those of the state together with what was booked. Distance is
// measured for each group of variables by how far it moved during the step.
#ifndef PM_SIM_INVARIANT_PROJECTION_H
#define PM_SIM_INVARIANT_PROJECTION_H

#include <stdbool.h>

#include "model/spec.h"

// What a part must have, from its start on, so that what one step leaves unbalanced (rounding, at
// least) the next makes good; and the size of what the step has summed up, the scale of rounding.
typedef struct pm_invariant_projection {
    double energy, energy_gross;   // J
    double entropy, entropy_gross; // J/K
} pm_invariant_projection;

// What the part has at its start.
void pm_invariant_projection_start(pm_invariant_projection *balance, double E, double S);

// Adds a stage of weight h b_i: covectors dE, dS and rate k [n]. Covectors may be NULL: zero.
// `first`: of a step.
void pm_invariant_projection_book(pm_invariant_projection *balance, bool first, double weight,
                                  int n, const double *dE, const double *dS, const double *k);

// One step of Newton's method: moves z [layout->nz], the state after the step from `start`, at
// which E, S, dE, dS were taken. False: z was left as it is, since it has what it must, or since
// there is no way there as short as the step itself (as when energy and entropy depend on the state
// alike, at rest, or where the step is far too long). Then what is lacking is written off, lest a
// later step make good what is not its own: the totals show it.
bool pm_invariant_projection_move(pm_invariant_projection *balance, const pm_layout *layout,
                                  const double *start, double E, double S, const double *dE,
                                  const double *dS, double *z);

#endif
