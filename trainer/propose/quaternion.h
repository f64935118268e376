// Unit quaternions: the attitude of a body with an angular momentum of three components. With the
// angular velocity w, the rate of a quaternion q is q w/2 if w is seen from the body, and w q/2 if
// it is seen from outside (J. B. Kuipers, Quaternions and Rotation Sequences, 1999).
#ifndef PM_TRAINER_PROPOSE_QUATERNION_H
#define PM_TRAINER_PROPOSE_QUATERNION_H

#include "propose/look.h"

// The order of the components of a quaternion and the frame of its angular velocity.
typedef struct pm_quaternion {
    int turns;        // 1: w is seen from the body; -1: from outside; 0: no quaternion
    bool scalar_last; // the scalar part is the last component, else the first
} pm_quaternion;

// Examines a group of four components and an angular momentum of three components. The group is a
// quaternion if it keeps its length in the examined states and if, for one order and one frame, its
// angular velocity is a linear function of the angular momentum, as the body sees both, but for a
// tenth of its variance.
pm_quaternion pm_look_at_quaternion(const pm_look *look, const pm_look_group *target,
                                    const pm_look_group *spin);

// Returns the term of q or w that one component of the angular velocity contributes to the rate of
// one component of the quaternion: rate_row = sum over axes of sign q_column w_axis/2. `row` and
// the result *column are positions in the group, `axis` is 0 to 2. Returns the sign, 1 or -1.
int pm_quaternion_term(pm_quaternion order, int row, int axis, int *column);

#endif
