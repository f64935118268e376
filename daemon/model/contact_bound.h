// A bound for contact. The energy of contact is a sum of terms |min(x,0)|^2, where x are the
// openings between two bodies. The energy and its gradient vanish while every x is positive. The
// bound says how much x can change while the state moves within a box, so that a contact which
// stays open need not be evaluated (sim/contact_broadphase.h).
#ifndef PM_MODEL_CONTACT_BOUND_H
#define PM_MODEL_CONTACT_BOUND_H

#include "model/part.h"

// Builds the bound of a part. A group is called unconstrained if energy and entropy depend on it
// only through such sums. `unconstrained` [nz] becomes true for the components of these groups.
// `value` [1][n] holds all x at the state z [1][nz]. `spread` [1][n] bounds the change of x if each
// unconstrained component c changes by at most width[c] (`width` [1][nz]) and all others stay; it
// includes rounding. The method is interval arithmetic in midpoint-radius form (Neumaier, Interval
// Methods for Systems of Equations, 1990). Returns false if there is no bound: no group is
// unconstrained, an x depends on unconstrained components through other operations than sums and
// products, or there are more than eight sums. `unconstrained` is written in every case.
bool pm_contact_bound_build(pm_graph *g, const pm_part *part, pm_node z, pm_node width,
                            bool *unconstrained, pm_node *value, pm_node *spread);

#endif
