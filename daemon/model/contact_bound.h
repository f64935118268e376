// A bound for contact. The energy of contact is a sum of terms |min(x,0)|^2, which vanishes with
// its gradient while every x is positive. The bound says how far the state may move while every x
// stays positive. Checking it takes a bound of x, not x itself (sim/contact_broadphase.h).
#ifndef PM_MODEL_CONTACT_BOUND_H
#define PM_MODEL_CONTACT_BOUND_H

#include "model/part.h"

// Builds the bound of a part. A group is unconstrained if energy and entropy depend on it only
// through such sums; unconstrained[c] [nz] is set for its components c. `value` [1][n] holds all x
// at the state z [1][nz]. `spread` [1][n] bounds the change of x where each unconstrained component
// c changes by at most width[c] (`width` [1][nz]) and no other component does; it includes
// rounding. The arithmetic is that of intervals given by middle and radius (Neumaier, Interval
// Methods for Systems of Equations, 1990). Returns false if there is no bound: no group is
// unconstrained, an x is made of unconstrained components by other operations than sums and
// products, or there are more than eight sums. `unconstrained` is written all the same.
bool pm_contact_bound_build(pm_graph *g, const pm_part *part, pm_node z, pm_node width,
                            bool *unconstrained, pm_node *value, pm_node *spread);

#endif
