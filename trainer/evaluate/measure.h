// Measures how good a system is on some trajectories of a dataset, for each group of each
// subsystem: errors of rollouts and of single steps, compared with persistence, the prediction that
// every state stays as it is.
#ifndef PM_TRAINER_EVALUATE_MEASURE_H
#define PM_TRAINER_EVALUATE_MEASURE_H

#include "evaluate/thermo.h"

// The errors of one group of one subsystem, as fractions.
typedef struct pm_measure_cell {
    const char *part, *group;
    pm_box rollout;     // relative L2 errors of the rollouts; infinite where not finite
    pm_box persistence; // relative L2 errors if the first state replaces all later ones
    double one_step;    // relative L2 error of the change over one step that begins in a true
                        // state; NAN: not measured
} pm_measure_cell;

typedef struct pm_measure {
    pm_arena arena;
    pm_evaluation *evaluation; // NULL: nothing was measured
    pm_thermo thermo;
    int ncell;
    pm_measure_cell *cell; // [ncell]
    int failures;          // rollouts that became non-finite
    // The geometric mean over rollouts and cells of the error divided by that of persistence. Cells
    // that do not change are left out. A rollout that is not finite counts as a large number.
    double score;
    double *each; // [evaluation->count] likewise of each rollout, the logarithm
} pm_measure;

// Rolls out trajectories first to end-1. With `thorough` it also fills `thermo`, and measures
// single steps in scenes without boundary inputs. The results do not depend on the number of
// threads. Fails like pm_evaluate. The caller frees.
pm_status pm_measure_make(pm_measure *measure, const pm_system *system, const pm_dataset *dataset,
                          int first, int end, bool thorough, const pm_evaluate_how *how);
// Trains a black box (inference/black_box.h) on trajectories 0 to ntraining-1 for `seconds` of a
// nominal machine, and measures the rollouts of first to end-1, which are those of the training
// part or begin behind it. `name` [80] receives what it is. measure->evaluation is NULL if there is
// none, since the scene has too many variables or the dataset lacks some. PM_ENOMEM. The caller
// frees.
pm_status pm_measure_black_box(pm_measure *measure, const pm_system *system,
                               const pm_dataset *dataset, int ntraining, int first, int end,
                               double seconds, char *name);
void pm_measure_free(pm_measure *measure); // NULL and a zeroed structure are allowed

#endif
