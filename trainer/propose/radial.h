// Finds on which function of its length the energy of a vector depends.
#ifndef PM_TRAINER_PROPOSE_RADIAL_H
#define PM_TRAINER_PROPOSE_RADIAL_H

#include "propose/look.h"

// Returns true if a polynomial of |q| represents the energy of a position q of two or three
// components clearly better than a polynomial of ln|q|. The energy has degree 4, and its first two
// derivatives may depend linearly on the `count` entropies. A regression of p' . q shows the force
// along q, where p is the momentum of q; friction and boundary inputs may contribute to it.
bool pm_look_prefers_length(const pm_look *look, const pm_look_group *q, const pm_look_group *p,
                            int count, const pm_look_group *entropy);

#endif
