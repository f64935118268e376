// The fastest decay that a dataset shows. Stiff dynamics hide in their data: after a short time all
// states are close to a slow manifold, where rates change slowly. How strongly rates depend on the
// state still tells how fast a deviation from this manifold would decay, and so which time steps an
// explicit integrator needs.
#ifndef PM_TRAINER_PROPOSE_DECAY_H
#define PM_TRAINER_PROPOSE_DECAY_H

#include "propose/look.h"

// Returns the fastest decay in 1/s, or 0 if the data show none: the largest row sum of |d rate_c/d
// z_d| over components d that have the unit of c (a bound on eigenvalues, Gershgorin), for all
// components c whose rate falls with c itself. The derivatives are those of a linear regression of
// the rates on all components, their squares, the logarithms of the lengths of vectors and the
// boundary inputs; one that is less than a few times its standard error counts as 0. Returns 0 for
// scenes of many components and if memory runs out.
double pm_look_decay(const pm_look *look);

#endif
