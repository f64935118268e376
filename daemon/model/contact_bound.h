// The clearance of a part whose energy acts only where something is closed, sums of |min(x,0)|^2:
// how far its state may move while every x stays positive, so that these sums stay exactly zero,
// and flat. It takes a bound of what x can become, not x itself.
#ifndef PM_MODEL_CONTACT_BOUND_H
#define PM_MODEL_CONTACT_BOUND_H

#include "model/part.h"

// The groups that `energy` and `entropy` depend on by such sums alone are unconstrained:
// unconstrained[c] is set for their components, [nz]. `value` [1][n] are all x at z, and `spread`
// [1][n] how far they change at most where each unconstrained component c changes by at most
// width[c], `width` [1][nz], and nothing else does (intervals given by middle and radius: Neumaier,
// Interval Methods for Systems of Equations, 1990). What rounding adds is in it. Returns false,
// `unconstrained` being written all the same, if nothing is unconstrained, an x is made of what is
// unconstrained by other operations than sums and products, or there are more than eight sums.
bool pm_contact_bound_build(pm_graph *g, const pm_part *part, pm_node z, pm_node width,
                            bool *unconstrained, pm_node *value, pm_node *spread);

#endif
