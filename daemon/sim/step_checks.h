// The checks at the end of a step of a subsystem. A failure names the subsystem and the value.
#ifndef PM_SIM_STEP_CHECKS_H
#define PM_SIM_STEP_CHECKS_H

#include "model/training_range.h"
#include "scene/scene.h"

// Fails if a component of the state z [nz] is not finite. PM_ENUMERIC.
pm_status pm_step_check_finite(const pm_scene_subsystem *subsystem, const double *z);

// Fails if the energy E (J) or entropy S (J/K) is not finite. PM_ENUMERIC.
pm_status pm_step_check_potentials(const pm_scene_subsystem *subsystem, double E, double S);

// Sets *outside to whether the state z [nz] after step number `step` is outside the training range.
// Fails if it is further outside than the scene's guard allows. PM_ENUMERIC.
pm_status pm_step_check_range(const pm_scene *scene, const pm_scene_subsystem *subsystem,
                              pm_training_range range, const double *z, long step, bool *outside);

#endif
