// A fit in progress, shared by the files that make up `portmet-train fit`: its input, its position
// in the stages, and the best weights so far.
#ifndef PM_TRAINER_LEARN_FIT_H
#define PM_TRAINER_LEARN_FIT_H

#include <signal.h>
#include <stdio.h>

#include "base/progress.h"
#include "evaluate/measure.h"
#include "learn/split.h"
#include "learn/training.h"
#include "store/checkpoint.h"

// The command line of a fit. Texts are borrowed; NULL: not given.
typedef struct pm_fit_arguments {
    const char *config, *data, *output, *trajectories, *validation;
    const char *data_set; // name of the dataset of measurements; NULL: as the training file says
    const char *seed;     // of first weights and batches; NULL: as the training file says
    bool resume, black_box;
    const pm_team *team; // the processes that train together; NULL: this one alone
    double limit;        // s of CPU time, after which the fit ends with the weights it has; 0: none
    char line[1024];     // the whole command, for the weights files
} pm_fit_arguments;

#define PM_FIT_CHECKPOINT_INTERVAL 30.0 // s
#define PM_FIT_MOST_EXTRA 4

// The position of a fit, as a checkpoint stores it.
enum {
    PM_FIT_STAGE,
    PM_FIT_DONE,       // completed iterations of the stage
    PM_FIT_SECONDS,    // s of training so far
    PM_FIT_ROBUST,     // the robust scale D^2 (learn/objective.h)
    PM_FIT_BATCHES,    // adam: completed batches of the next iteration
    PM_FIT_LOSS,       // adam: the sum of the losses of these batches
    PM_FIT_BEST,       // the score of the best weights; -1: none yet
    PM_FIT_BEST_STAGE, // where the best weights were found
    PM_FIT_BEST_DONE,
    PM_FIT_ATTEMPT, // completed trainings from other initial weights
    PM_FIT_FINER,   // how often the substeps of all stages of steps have been doubled
    PM_FIT_DIGEST,  // the digest of each stage (learn/training.h)
    PM_FIT_POSITION = PM_FIT_DIGEST + PM_MAX_TRAINING_STAGES
};

typedef struct pm_fit {
    const pm_fit_arguments *arguments; // borrowed
    pm_arena arena;
    pm_training *training;
    const char *data;                 // path of the dataset
    pm_dataset *dataset;              // reordered by the split
    struct pm_fit_measured *measured; // learn/fit_measured.h; NULL: the data are states
    pm_split split;
    uint64_t *seen; // [trajectories] their digests
    const volatile sig_atomic_t *stop;
    char *checkpoint;                             // path
    pm_checkpoint_field extra[PM_FIT_MOST_EXTRA]; // [nextra] what else a checkpoint holds
    int nextra;
    uint64_t digest;  // of all inputs that determine the result, except the stages
    int size;         // the number of weights
    double *theta;    // [size] the present weights
    double *moment;   // [2][size] the memory of the optimiser
    double *best;     // [size] the best weights so far
    double *declared; // [size] the weights before any random draw
    double position[PM_FIT_POSITION];
    int stage;
    int interval;     // iterations between two validations
    double saved;     // s, monotonic clock, at the last checkpoint
    double loss;      // as last reported
    double validated; // s of wall time that validation took
    double processor; // s of CPU time of the process at the beginning of the fit
    bool expired;     // the time limit is over
    int nrow, nscore; // rows of fit.csv, and rows that have a validation
    FILE *curves;     // fit.csv
    pm_progress progress;
} pm_fit;

// --- learn/fit.c: a training from its file to its last stage ---

// Reads the training file and the data, divides the data, chooses the initial weights, and loads
// the checkpoint with --resume. `arguments` and `stop` must outlive the fit. The caller closes the
// fit in any case. Fails like the functions that it calls, with one line that names file and value.
pm_status pm_fit_open(pm_fit *fit, const pm_fit_arguments *arguments,
                      const volatile sig_atomic_t *stop);
// Runs the remaining stages. Afterwards the system holds the best weights. PM_EINTERRUPTED if *stop
// becomes nonzero; PM_ENUMERIC if the loss is not finite.
pm_status pm_fit_run(pm_fit *fit);
void pm_fit_close(pm_fit *fit);
// Returns the CPU time that the fit has taken in this process, in s.
double pm_fit_processor_time(const pm_fit *fit);

// --- learn/fit_save.c: checkpoints and weights files ---

// Checks that no two components share a weights file. PM_ECONFIG.
pm_status pm_fit_check_names(const pm_scene *scene);
// Writes the checkpoint, and the best weights so far as weights files. If `loud`, prints the names
// of the weights files. PM_EFILE, PM_ENOMEM.
pm_status pm_fit_save(pm_fit *fit, bool loud);
// Loads the checkpoint. PM_EFILE if it is missing or if another training file or dataset made it.
pm_status pm_fit_load(pm_fit *fit);
// Writes theta [size] into the system.
void pm_fit_set_weights(pm_fit *fit, const double *theta);
// Returns the weights [size] to be kept: the best by validation, or the present ones if nothing was
// validated.
const double *pm_fit_kept(const pm_fit *fit);

// --- learn/fit_validate.c: rollouts on the validation part, and the curves ---

// Returns the number of iterations between two validations of a stage, such that validation takes
// at most a tenth of the time. Operations are counted instead of seconds, so that results do not
// depend on the clock.
int pm_fit_interval(const pm_fit *fit, const pm_stage *stage);
// Rolls out on the validation part with the present weights, and keeps them if they are the best so
// far. Writes their score (evaluate/measure.h) to *score, or NAN without a validation part.
pm_status pm_fit_validate(pm_fit *fit, double *score);
// Opens DIR/fit.csv, which a resumed fit appends to. PM_EFILE.
pm_status pm_fit_open_curves(pm_fit *fit);
// Writes one row of fit.csv.
void pm_fit_write_curves(pm_fit *fit, const char *optimiser, double loss, double score);
// Draws fit.csv as fit.png if gnuplot is installed.
void pm_fit_draw_curves(const pm_fit *fit);

// --- learn/fit_report.c: the table and the verdict at the end ---

// Measures the system with its present weights and prints the table and the verdict. `black_box` is
// a measure of a model without structure on the validation part, or NULL. PM_EUNFIT if rollouts are
// not finite or worse than persistence, a state that stays as it is.
pm_status pm_fit_report(pm_fit *fit, const pm_measure *black_box);

// Returns the verdict on a model that is better than persistence: "good", "fair" or "poor". `score`
// is the geometric mean over groups of the errors of rollouts relative to persistence, `worst` the
// largest of these ratios among groups whose error is not negligible.
const char *pm_fit_grade(double score, double worst);
// Measures the system on the validation part if `validation` is true, else on the training part.
// The caller frees *measure. Fails as the functions of evaluate/measure.h do.
pm_status pm_fit_measure(const pm_fit *fit, bool validation, pm_measure *measure);

#endif
