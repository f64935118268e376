// A training file: which models the parts of a scene get, on which data, and by which stages.
#ifndef PM_TRAINER_LEARN_TRAINING_H
#define PM_TRAINER_LEARN_TRAINING_H

#include <stdint.h>

#include "learn/objective.h"
#include "learn/optimiser.h"
#include "scene/system.h"

#define PM_MAX_TRAINING_STAGES 16

typedef struct pm_stage {
    const pm_optimiser *optimiser;
    pm_schedule schedule;
    pm_loss loss;
    int unroll;
} pm_stage;

typedef struct pm_training {
    pm_arena arena; // owns all that follows
    const char *path;
    pm_scene *scene;
    pm_system *system;          // models declared, weights not yet drawn
    const char *data, *data_at; // dataset, or NULL: only from the command line; and its place,
                                // "file:line:column", for errors found later
    const char *trajectories, *trajectories_at; // "A:B", or NULL: all
    const char *validation, *validation_at;     // a list, "none", or NULL: as learn/split.h says
    uint64_t seed;
    bool square; // samples have symmetric images (learn/symmetry.h)
    bool plain;  // models are as they are written (learn/defaults.h)
    int tries,
        try_iterations; // starts to choose from, and iterations of each at first (learn/start.h)
    int nstage;
    pm_stage stage[PM_MAX_TRAINING_STAGES];
    uint64_t digest; // of everything that decides the result but the data and the stages
    // Of each stage, without its number of iterations: a stage may become longer when a training is
    // taken up again. 32 bits, so that a double holds it.
    uint32_t stage_digest[PM_MAX_TRAINING_STAGES];
} pm_training;

// Reads and checks a training file and declares the models. PM_EFILE, PM_ECONFIG, PM_ENOMEM. The
// caller frees.
pm_status pm_training_load(pm_training **training, const char *path);
void pm_training_free(pm_training *training); // NULL is allowed

#endif
