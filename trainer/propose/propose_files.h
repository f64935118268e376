// Proposals with file names as input and output, for the commands propose and fit.
#ifndef PM_TRAINER_PROPOSE_PROPOSE_FILES_H
#define PM_TRAINER_PROPOSE_PROPOSE_FILES_H

#include <stdbool.h>

#include "model/spec.h"

// Reads a scene and a dataset and writes the training file `output`. For the form free it
// also writes the scene that this file names, "<output without its ending>_scene.yaml". Prints the
// names of the files that it wrote. Fails like pm_propose.
pm_status pm_propose_files(const char *scene, const char *data, pm_form form, const char *output);

// Returns true if a YAML file is a scene and not a training file: a scene has the key `time`.
bool pm_propose_is_scene(const char *path);

#endif
