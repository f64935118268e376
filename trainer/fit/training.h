// A training file as it was read: the models of the subsystems and ports of a scene, the data, and
// the stages of the training. trainer/TRAINING.md explains its keys.
#ifndef PM_TRAINER_FIT_TRAINING_H
#define PM_TRAINER_FIT_TRAINING_H

#include <stdint.h>

#include "loss/objective.h"
#include "optimise/optimiser.h"
#include "scene/system.h"

#define PM_MAX_TRAINING_STAGES 16

// A stage: one optimiser that minimises one loss.
typedef struct pm_stage {
    const pm_optimiser *optimiser;
    pm_schedule schedule;
    pm_loss loss;
    int unroll; // steps in a window
} pm_stage;

typedef struct pm_training {
    pm_arena arena; // owns all texts and arrays below
    const char *path;
    pm_scene *scene;
    pm_system *system; // the models are declared, the weights not yet drawn
    // The members that end in _at are places, "file:line:column", for errors that are found later.
    const char *data, *data_at;                 // the dataset, or NULL: named on the command line
    const char *trajectories, *trajectories_at; // "A:B", or NULL: all
    const char *validation, *validation_at;     // a list, "none", or NULL (data/split.h)
    // The key `noise` of measurements (fit/fit_measured.c).
    bool noisy; // the file has this key
    // The data are measurements, which are fitted by multiple shooting: the file gives `noise`, or
    // the scene has hidden groups or observations.
    bool measured;
    int nnoise;                // number of columns whose noise it gives
    const char **noise_column; // [nnoise]
    double *noise;             // [nnoise] in the unit of the column
    const char *noise_at;
    double seconds;       // only the first seconds of each trajectory are used; infinite: all
    int pieces;           // into which each trajectory of measurements is divided; 1: it is not
    const char *data_set; // the dataset of the file that holds the measurements; NULL: z
    uint64_t seed;
    bool plain;         // models stay as they are written (fit/defaults.h)
    const char *from;   // path of the weights with which attempt 0 starts; NULL: draws
    int tries;          // initial draws to choose from (fit/start.h)
    bool whole;         // measurements: the first windows are whole trajectories
    int try_iterations; // iterations of each draw in the first round
    int substeps;       // of the loss; a fit to measurements, which has no stages, ends with them
    int nstage;
    pm_stage stage[PM_MAX_TRAINING_STAGES];
    uint64_t digest; // of all inputs that determine the result, except the data and the stages
    // The digest of each stage, without its number of iterations: a resumed training may have
    // longer stages. It has 32 bits, so that a double can hold it.
    uint32_t stage_digest[PM_MAX_TRAINING_STAGES];
} pm_training;

// Reads and checks a training file and its scene, and declares the models. The caller frees.
// PM_EFILE, PM_ECONFIG with the place in the file, PM_ENOMEM.
pm_status pm_training_load(pm_training **training, const char *path);
void pm_training_free(pm_training *training); // NULL is allowed

#endif
