// Scores predictions from estimated starts against states without noise, hidden variables included.
// This is for tests of a method, where such states exist: `evaluate --estimate --truth FILE`.
#ifndef PM_TRAINER_COMMAND_EVALUATE_TRUTH_H
#define PM_TRAINER_COMMAND_EVALUATE_TRUTH_H

#include "learn/estimate.h"

// The relative L2 errors of each group of variables of the scene, over all samples of a trajectory.
// Groups of the same name in several subsystems share one score (sim/score.h).
typedef struct pm_truth_errors {
    pm_arena arena; // owns all
    int count, ngroup;
    const char **group; // [ngroup] names
    double *error;      // [ngroup][count]
} pm_truth_errors;

// Compares the states of `estimate`, whose trajectories are which [count] of the measurements
// `data`, with those at the same times in the file `path`, a dataset with a trajectory for each
// trajectory of `data`. The caller frees. PM_EDATA: the file lacks a column, a trajectory or a time
// of the measurements; PM_EFILE, PM_ENOMEM.
pm_status pm_truth_errors_make(pm_truth_errors *errors, const pm_scene *scene,
                               const pm_estimate *estimate, const pm_dataset *data,
                               const int *which, const char *path);
void pm_truth_errors_free(pm_truth_errors *errors); // zeroed storage is allowed

// Prints median, mean and largest error of each group in %. PM_ENOMEM.
pm_status pm_truth_errors_print(const pm_truth_errors *errors);

#endif
