// Finds the initial state of a run that begins where a record of measurements begins (`estimate`
// under `reference`). The command portmet-train evaluate --estimate computes it.
#ifndef PM_LIBRARY_ESTIMATED_START_H
#define PM_LIBRARY_ESTIMATED_START_H

#include "scene/scene.h"
#include "store/dataset.h"

// Estimates the state in which trajectory scene->reference_trajectory of the measurements
// scene->reference begins, from its first scene->reference_estimate seconds. *states receives a
// dataset of the predicted states, whose trajectory 0 begins with this state; the caller frees it.
// The program portmet-train is looked for in the folder of the running program, then in PATH.
// `weights` is the folder of the weights; NULL: where the scene says. PM_EFILE: the program is not
// found, or no temporary file can be made; PM_EDATA: it fails, after having said why on standard
// error.
pm_status pm_estimated_start(const pm_scene *scene, const char *weights, pm_dataset **states);

#endif
