// Whether a dataset shows dynamics that do not depend on directions.
#ifndef PM_TRAINER_PROPOSE_ROTATION_H
#define PM_TRAINER_PROPOSE_ROTATION_H

#include "propose/look.h"

// Returns true if the angular momentum, the sum of q[i] x p[i] over `count` conjugate pairs of
// groups of two or three components, is constant along each trajectory, but for the moments of
// boundary inputs. A boundary input of as many components whose co-energy is e, such as a force or
// the velocity of a pivot, changes the angular momentum at the rate a q x e + b p x e, with two
// numbers a and b for each input that the data must show. The sum is taken in the coordinates of
// the dataset's columns. The dynamics then do not depend on directions. Returns false if there are
// no pairs or all their products vanish, and if memory runs out.
bool pm_look_keeps_rotation(const pm_look *look, int count, const pm_look_group *q,
                            const pm_look_group *p);

#endif
