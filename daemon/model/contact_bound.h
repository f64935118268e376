// A bound for contact. The energy of contact is a sum of terms |min(x,0)|^2, where x are the
// openings between two bodies. The energy and its gradient vanish while every x is positive. The
// bound says how much x can change while the state moves within a box, so that a contact which
// stays open need not be evaluated (sim/contact_broadphase.h).
#ifndef PM_MODEL_CONTACT_BOUND_H
#define PM_MODEL_CONTACT_BOUND_H

#include "model/part.h"

// Builds the bound of a part at the state z [1][nz], for a box of states around z. In the box each
// unconstrained component c changes by at most width[c] (`width` [1][nz]), and all others stay. The
// results are
//   unconstrained [nz]  true for the components of a group if energy and entropy depend on the
//                       group only through sums of terms |min(x,0)|^2; written in every case
//   value [1][n]        all x at the state z
//   spread [1][n]       bounds of the change of each x within the box, which include rounding
// The method is interval arithmetic in midpoint-radius form (Neumaier, Interval Methods for Systems
// of Equations, 1990). Returns false if there is no bound: no group is unconstrained, an x depends
// on unconstrained components through other operations than sums and products, or there are more
// than eight sums.
bool pm_contact_bound_build(pm_graph *g, const pm_part *part, pm_node z, pm_node width,
                            bool *unconstrained, pm_node *value, pm_node *spread);

#endif
