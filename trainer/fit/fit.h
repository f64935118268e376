// A fit in progress: its input, its position, and the best weights so far. What it does with the
// data depends on their kind: states at equal steps (fit/fit_states.c), or measurements with
// noise, gaps and hidden variables (fit/fit_measured.c).
#ifndef PM_TRAINER_FIT_FIT_H
#define PM_TRAINER_FIT_FIT_H

#include <signal.h>
#include <stdio.h>

#include "base/progress.h"
#include "data/observation.h"
#include "data/split.h"
#include "evaluate/measure.h"
#include "fit/training.h"
#include "store/snapshot.h"

// Shortens a fit, so that training files can be compared. Such a fit has one attempt, and finds no
// uncertainty.
typedef struct pm_fit_effort {
    int tries, try_iterations; // at most so many draws of the first weights, and iterations of each
    int samples;               // at most so many samples in a batch
    // At most so many in each stage; measurements: steps of the continuation in all, 0: the fit
    // only shows whether its first weights can be integrated, and is not judged.
    int iterations;
    int stages; // at most so many
    // Measurements: of CPU time on a nominal machine (PM_SHOOTING_SPEED), after which it ends; 0:
    // no limit.
    double seconds;
    bool whole; // measurements: it begins with whole trajectories, since weights are good
} pm_fit_effort;

#define PM_FIT_SCORED_GROUPS 64
#define PM_FIT_SCORED_ROLLOUTS 8

// How good the weights of a fit are on the validation part, or on the training part where there is
// none. Errors as fractions; NAN: not measured; infinite: not finite.
typedef struct pm_fit_score {
    double step;    // of the change over one step: the geometric mean over groups
    double rollout; // states: relative to persistence, the geometric mean over groups;
                    // measurements: relative to the deviation, the geometric mean over columns
    // Measurements: the negative logarithm of the likelihood of the training part, but for a
    // constant; NAN: the fit was ended.
    double misfit;
    double coarse;     // measurements: what the steps of the scene cost (pm_estimate.coarse)
    double production; // of the entropy produced over a rollout: the median
    // States: of each group in the order of the scene, of one step, or where that is not measured
    // of rollouts relative to persistence; 0: the group does not change, or is not measured.
    // Measurements: of each column of the dataset.
    double group[PM_FIT_SCORED_GROUPS];
    // The logarithms of the errors of single rollouts relative to persistence.
    int nrollout;
    double each[PM_FIT_SCORED_ROLLOUTS]; // [nrollout]
} pm_fit_score;

// The command line of a fit. Texts are borrowed; NULL: not given.
typedef struct pm_fit_arguments {
    const char *config, *data, *output, *trajectories, *validation;
    const char *budget;   // s for a proposal (propose/propose.h)
    const char *data_set; // name of the dataset of measurements; NULL: as the training file says
    int64_t seed;         // of first weights and batches; 0: as the training file says
    bool resume, black_box;
    const pm_team *team; // the processes that train together; NULL: this one alone
    double limit;        // s of CPU time, after which the fit ends with the weights it has; 0: none
    const pm_fit_effort *effort; // of a short fit; NULL: the whole
    char line[1024];             // the whole command, for the weights files
} pm_fit_arguments;

#define PM_FIT_CHECKPOINT_INTERVAL 30.0 // s
// s of a nominal machine, for a black box beside the fit: about 0.4 s of CPU time. It depends
// neither on a clock nor on the model, so that data have the same black box on every machine.
#define PM_FIT_BLACK_BOX_SECONDS 1.0
#define PM_FIT_MOST_EXTRA 5

// The position of a fit in its stages.
typedef struct pm_fit_position {
    int stage;
    int done;       // completed iterations of the stage
    double seconds; // s of training so far
    double robust;  // the robust scale D^2 (loss/objective.h)
    int batches;    // adam: completed batches of the next iteration
    double loss;    // adam: the sum of the losses of these batches
    double best;    // the score of the best weights; -1: none yet
    int best_stage; // where the best weights were found
    int best_done;
    int attempt; // completed trainings from other initial weights
    int finer;   // how often the substeps of all stages of steps have been doubled
} pm_fit_position;

#define PM_FIT_MEASURED_POINT 11 // numbers of a point of the continuation

// The measurements of a fit.
typedef struct pm_fit_measured {
    pm_dataset *data; // the measurements
    pm_observation observation;
    double *noise; // [observation.count] given noise in the unit of the column; 0: to be estimated
    double *typical; // [nz] typical size of hidden components; 0: not known
    // The point from which an interrupted fit goes on (pm_continuation_point, as numbers), with the
    // noise [observation.count], the gaps and the deviations of later starts [2][nz], and the
    // starts [nstart] of all windows; f->theta has its weights.
    double point[PM_FIT_MEASURED_POINT], *point_noise, *point_gap, *point_start;
    int nstart;
    // [nz] by how much hidden components move, in deviations of their starts; 0: as the scene says.
    double *moved;
    // [size] the role of each weight: 1 in the linear output of a network that stands beside a
    // formula, 2 elsewhere in such a network, 0 outside of them.
    unsigned char *beside;
    // [size][size] which constants are optional, with what means nothing without them, and, after a
    // short fit, [size] which of them are spare (pm_uncertainty_spare). Both NULL in other fits.
    unsigned char *optional;
    int *spare;
    double *energy;     // [nsubsystem] pm_uncertainty_energies, after the fit; NAN: not known
    double *left_out;   // [ny] median error of trajectories or pieces that were left out; NAN: none
    double huber;       // pm_shooting_terms.huber unless windows begin as whole trajectories
    double seconds;     // of CPU time on a nominal machine, that fit and score have taken
    double misfit;      // pm_fit_score.misfit
    int longest;        // samples of the longest track
    long used, samples; // number of samples that the fit uses, and of all samples
} pm_fit_measured;

typedef struct pm_fit {
    const pm_fit_arguments *arguments; // borrowed
    const struct pm_fit_kind *kind;
    pm_arena arena; // owns all arrays
    pm_training *training;
    const char *data;    // path of the dataset
    pm_dataset *dataset; // reordered by the split
    pm_fit_measured measured;
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
    pm_fit_position position;
    int interval;                    // iterations between two validations
    double saved;                    // s, monotonic clock, at the last checkpoint
    double loss;                     // as last reported
    double processor;                // s of CPU time of the process at the beginning of the fit
    bool expired;                    // the time limit is over
    bool interrupted;                // the training has been interrupted, and reports what it has
    char verdict[PM_VERDICT_LENGTH]; // what weights files say of the fit (scene/weights.h)
    FILE *curves;                    // fit.csv
    int folder;                      // a descriptor of the folder, which is locked; -1: none
    pm_progress progress;
} pm_fit;

// What a fit does with one kind of data.
typedef struct pm_fit_kind {
    // Loads the data from f->data and makes f->dataset, states at the steps of the scene. May add
    // to f->extra what a checkpoint needs.
    pm_status (*load)(pm_fit *f);
    // Leaves out what the training does not use, after the digests; NULL: nothing.
    pm_status (*shorten)(pm_fit *f);
    // Prints how much data there are, behind the list of trajectories.
    void (*describe)(const pm_fit *f);
    // Chooses the initial weights, from the declared and the drawn ones.
    pm_status (*start)(pm_fit *f);
    // Goes on from a checkpoint that was loaded; NULL: `run` does so.
    void (*resume)(pm_fit *f);
    // Trains; afterwards f->theta and f->best hold the weights.
    pm_status (*run)(pm_fit *f);
    // Prints a report of the present weights. `black_box` is a measure of a model without structure
    // on the validation part; NULL: the report trains a regression (inference/black_box.h) beside,
    // for a part of the time of the fit. PM_EUNFIT if the model is of no use.
    pm_status (*report)(pm_fit *f, const pm_measure *black_box);
    // Scores the present weights.
    pm_status (*judge)(pm_fit *f, pm_fit_score *score);
} pm_fit_kind;

extern const pm_fit_kind pm_fit_of_states, pm_fit_of_measurements;

// --- fit/fit.c ---

// Reads the training file and the data, divides the data, chooses the initial weights, and loads
// the checkpoint with --resume. `arguments` and `stop` must outlive the fit. The caller closes the
// fit in any case. Fails like the functions that it calls, with one line that names file and value.
pm_status pm_fit_open(pm_fit *fit, const pm_fit_arguments *arguments,
                      const volatile sig_atomic_t *stop);
// Trains what remains. Afterwards the system holds the best weights. PM_EINTERRUPTED if *stop
// becomes nonzero; PM_ENUMERIC if the loss is not finite.
pm_status pm_fit_run(pm_fit *fit);
void pm_fit_close(pm_fit *fit);
// Prints a report of the present weights, as pm_fit_kind does. The weights files keep its verdict.
pm_status pm_fit_report(pm_fit *fit, const pm_measure *black_box);

// Scores the present weights, as pm_fit_kind does.
pm_status pm_fit_judge(pm_fit *fit, pm_fit_score *score);

// --- fit/fit_folder.c: what the kinds of fits use ---

// Returns the CPU time that the fit has taken in this process, in s.
double pm_fit_processor_time(const pm_fit *fit);
// Chooses initial weights by short fits to rates (fit/start.h), by the seed of the training and
// the number of the attempt. *loss becomes their loss there; it stays as it is if there is no
// choice.
pm_status pm_fit_search_start(pm_fit *fit, double *loss);
// Writes the present weights to a file with which fits of the same models may start. PM_EFILE.
pm_status pm_fit_save_start(pm_fit *fit, const char *path);
// Takes the weights of the file that the training file names. PM_EFILE, PM_ENOMEM.
pm_status pm_fit_load_start(pm_fit *fit);
// Checks that no two components share a weights file. PM_ECONFIG.
pm_status pm_fit_check_names(const pm_scene *scene);
// Writes the checkpoint, and the best weights so far as weights files. If `loud`, prints the names
// of the weights files. PM_EFILE, PM_ENOMEM.
pm_status pm_fit_save(pm_fit *fit, bool loud);
// Loads the checkpoint. PM_EFILE if it is missing or if another training file or dataset made it.
pm_status pm_fit_load(pm_fit *fit);
// Returns the weights [size] to be kept: the best by validation, or the present ones if nothing was
// validated.
const double *pm_fit_kept(const pm_fit *f);

// --- fit/verdict.c ---

// The verdict on a fit. It begins as good; each thing that is compared can only lower it.
typedef enum pm_grade { PM_GRADE_GOOD, PM_GRADE_FAIR, PM_GRADE_POOR } pm_grade;

#define PM_VERDICT_MOST 12

typedef struct pm_verdict {
    pm_grade grade;
    int count; // reasons why it is not good
    char reason[PM_VERDICT_MOST][200];
} pm_verdict;

// Errors of predictions relative to persistence below which a verdict is good or fair.
#define PM_VERDICT_GOOD 0.05
#define PM_VERDICT_FAIR 0.3
// The error of one step, relative to its length, below which a verdict may be good, of each group.
#define PM_VERDICT_STEP 0.3
// A model is not good if its error is this many times that of a black box, unless it is below this
// fraction of that of persistence.
#define PM_VERDICT_LOSES 1.25
#define PM_VERDICT_NEGLIGIBLE 1e-3

// Compares a number with the bounds below which the verdict may be good, and fair. If it is not
// below `good`, the reason, a format for what follows, is noted. NAN: not compared.
void pm_verdict_compare(pm_verdict *verdict, double value, double good, double fair,
                        const char *format, ...) __attribute__((format(printf, 5, 6)));
// Prints "Verdict: <grade>. " and the text, then the reasons. `record` becomes what weights files
// keep of it (scene/weights.h).
void pm_verdict_print(const pm_verdict *verdict, const char *text, char record[PM_VERDICT_LENGTH]);
// Prints and records that the model is unfit, for the reason that the format gives. PM_EUNFIT.
pm_status pm_verdict_unfit(char record[PM_VERDICT_LENGTH], const char *format, ...)
    __attribute__((format(printf, 2, 3)));

// --- fit/fit_states.c ---

// Measures the system on the validation part if `validation` is true, else on the training part.
// The caller frees *measure. Fails as the functions of evaluate/measure.h do.
pm_status pm_fit_measure(const pm_fit *fit, bool validation, pm_measure *measure);

#endif
