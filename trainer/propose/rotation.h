// Whether a dataset shows dynamics that do not depend on directions.
#ifndef PM_TRAINER_PROPOSE_ROTATION_H
#define PM_TRAINER_PROPOSE_ROTATION_H

#include "propose/look.h"

// How the angular momentum behaves, the sum of q x p over conjugate pairs of vectors.
typedef enum pm_rotation {
    PM_ROTATION_NONE,      // forces that depend on directions change it, or there are no pairs
    PM_ROTATION_CONSERVED, // it is constant along each trajectory
    PM_ROTATION_BALANCED   // friction and boundary inputs alone change it
} pm_rotation;

// Examines the sum of q[i] x p[i] over `count` conjugate pairs of groups of two or three components
// along each trajectory, in the coordinates of the dataset's columns. Friction changes q x p at a
// rate that is proportional to it. A boundary input of as many components whose co-energy is e,
// such as a force or the velocity of a pivot, changes it at the rate a q x e + b p x e. The numbers
// a and b of each input and the factor of the friction of each pair come from a regression. If
// these moments explain all changes, the dynamics do not depend on directions. Returns
// PM_ROTATION_NONE also if all products vanish, and if memory runs out.
pm_rotation pm_look_rotation(const pm_look *look, int count, const pm_look_group *q,
                             const pm_look_group *p);

#endif
