// A fit under way, shared by the files that make up `portmet-train fit`: what it works on, where it
// stands, and which weights were best so far.
#ifndef PM_TRAINER_LEARN_FIT_H
#define PM_TRAINER_LEARN_FIT_H

#include <signal.h>
#include <stdio.h>

#include "base/progress.h"
#include "evaluate/measure.h"
#include "learn/split.h"
#include "learn/training.h"

typedef struct pm_fit_arguments {
    const char *config, *data, *output, *trajectories, *validation;
    bool resume, black_box;
    double limit;    // s of training after which it ends with what it has; 0: none
    char line[1024]; // the command, for provenance
} pm_fit_arguments;

// Where a fit stands; kept in checkpoints.
enum {
    PM_FIT_STAGE,
    PM_FIT_DONE, // iterations done in the stage
    PM_FIT_SECONDS,
    PM_FIT_ROBUST,  // the robust scale squared
    PM_FIT_BATCHES, // done of the next iteration,
    PM_FIT_LOSS,    // and their loss
    PM_FIT_BEST,    // score of the best weights; -1: none yet
    PM_FIT_BEST_STAGE,
    PM_FIT_BEST_DONE,
    PM_FIT_DIGEST, // of each stage (learn/training.h)
    PM_FIT_POSITION = PM_FIT_DIGEST + PM_MAX_TRAINING_STAGES
};

typedef struct pm_fit {
    const pm_fit_arguments *arguments;
    pm_arena arena;
    pm_training *training;
    const char *data;    // path of the dataset
    pm_dataset *dataset; // sorted by the split
    pm_split split;
    uint64_t *seen; // [trajectories] digests
    const volatile sig_atomic_t *stop;
    char *checkpoint; // path
    uint64_t digest;
    int size;
    double *theta;  // [size]
    double *moment; // [2][size]
    double *best;   // [size] the best weights so far
    double position[PM_FIT_POSITION];
    int stage;
    int interval; // iterations between two validations
    double saved; // s, monotonic clock, at the last checkpoint
    double loss;
    double validated; // s that validation took, by the clock
    bool expired;     // the time limit is over
    int nrow, nscore; // lines of it written, and those with a validation
    FILE *curves;     // fit.csv
    pm_progress progress;
} pm_fit;

// --- learn/fit.c: a training from its file to its last stage ---

// Reads everything and takes up the checkpoint if it is to.
pm_status pm_fit_open(pm_fit *fit, const pm_fit_arguments *arguments,
                      const volatile sig_atomic_t *stop);
// Runs the stages that are left; when it ends, the system has the best weights.
pm_status pm_fit_run(pm_fit *fit);
void pm_fit_close(pm_fit *fit);

// --- learn/fit_save.c ---

pm_status pm_fit_check_names(const pm_scene *scene); // two components do not share a weights file
// Checkpoint, and the best weights so far as weights files. `loud`: their names are printed.
pm_status pm_fit_save(pm_fit *fit, bool loud);
pm_status pm_fit_load(pm_fit *fit);
// Writes weights into the system.
void pm_fit_set_weights(pm_fit *fit, const double *theta);
// The weights to be kept: the best by validation, or the present ones where nothing was validated.
const double *pm_fit_kept(const pm_fit *fit);

// --- learn/fit_validate.c ---

// How many iterations of a stage lie between two validations, such that these take a tenth of the
// time at most, as far as counting operations tells; so results do not depend on the clock.
int pm_fit_interval(const pm_fit *fit, const pm_stage *stage);
// Rolls out on the validation part with the present theta, and keeps the weights if they are the
// best so far. `score`: of these; NAN where there is no such part.
pm_status pm_fit_validate(pm_fit *fit, double *score);
// fit.csv: opened (further written when resuming), and a line for an iteration.
pm_status pm_fit_open_curves(pm_fit *fit);
void pm_fit_write_curves(pm_fit *fit, const char *optimiser, double loss, double score);
// Draws fit.csv as fit.png, if gnuplot is there.
void pm_fit_draw_curves(const pm_fit *fit);

// --- learn/fit_report.c ---

// Measures the system as it is, prints the table and the verdict. `black_box`: on the validation
// part, or NULL. PM_EUNFIT: worse than persistence, or not finite.
pm_status pm_fit_report(pm_fit *fit, const pm_measure *black_box);
// Measures on the validation part, or where there is none on the training part.
pm_status pm_fit_measure(const pm_fit *fit, bool validation, pm_measure *measure);

#endif
