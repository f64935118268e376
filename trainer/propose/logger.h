// Proposes a scene and a training file for the tables of a logger, without a scene.
#ifndef PM_TRAINER_PROPOSE_LOGGER_H
#define PM_TRAINER_PROPOSE_LOGGER_H

#include "propose/logger_view.h"

// The budget where none is named, s.
#define PM_LOGGER_BUDGET 90.0

// Writes scene.yaml and training.yaml into the folder, which exists, for the measurements in
// `data`. Prints what the columns are, and the names of the files. Fails as pm_logger_look does;
// PM_EFILE.
pm_status pm_propose_logger(const char *data, const pm_logger_hints *hints, const char *folder);

#endif
