// Couplings without loss between two variables that both change their sign when time runs
// backwards: each drives the other, with opposite coefficients. A magnetic field couples the
// components of a momentum in this way, and the magnet of a motor couples a flux with an angular
// momentum.
#ifndef PM_TRAINER_PROPOSE_GYRATION_H
#define PM_TRAINER_PROPOSE_GYRATION_H

#include "propose/look.h"

// Returns true if two components of a momentum drive each other with opposite coefficients.
// `position` is its conjugate variable, of as many components.
bool pm_look_gyroscopic(const pm_look *look, const pm_look_group *position,
                        const pm_look_group *momentum);
// Returns true if a momentum and another group, of as many components, drive each other with
// coefficients of opposite signs.
bool pm_look_gyrates(const pm_look *look, const pm_look_group *position,
                     const pm_look_group *momentum, const pm_look_group *other);

#endif
