// A training file for a scene that somebody brings, from what its units, its ports and a look at
// its data say: which variables are conjugate, which are entropies, what dissipates, what is
// invariant.
#ifndef PM_TRAINER_PROPOSE_PROPOSE_H
#define PM_TRAINER_PROPOSE_PROPOSE_H

#include "model/spec.h"
#include "scene/scene.h"
#include "store/dataset.h"

typedef struct pm_proposal {
    const pm_scene *scene;
    const pm_dataset *dataset;
    const char *scene_path; // as the training file is to name it
    const char *data_path;  // likewise
    pm_form form;
} pm_proposal;

// Writes the file, with comments that say why, as `path`. PM_EFILE; PM_EDATA and PM_ECONFIG
// (columns that the data do not have, trajectories too short); PM_ENOMEM.
pm_status pm_propose(const pm_proposal *proposal, const char *path);

// Writes the scene at `from` as `path`, with the law exchange in the place of bracket, as ports of
// the forms soft and free have. PM_EFILE.
pm_status pm_propose_scene(const char *from, const char *path);

#endif
