// A proposal from files to files, as the commands propose and fit make it.
#ifndef PM_TRAINER_PROPOSE_PROPOSE_FILES_H
#define PM_TRAINER_PROPOSE_PROPOSE_FILES_H

#include <stdbool.h>

#include "model/spec.h"

// Writes the training file `output` for a scene and a dataset, and for the forms soft and free the
// scene that it names beside it, "<output without its ending>_scene.yaml". Prints what it wrote.
// As pm_propose.
pm_status pm_propose_files(const char *scene, const char *data, pm_form form, const char *output);

// Whether a YAML file is a scene, which says how time is stepped, and not a training file.
bool pm_propose_is_scene(const char *path);

#endif
