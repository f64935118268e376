// Divides the trajectories of a dataset into a training part and a validation part. Rollouts on the
// validation part measure the weights during training and decide which weights are kept.
#ifndef PM_TRAINER_DATA_SPLIT_H
#define PM_TRAINER_DATA_SPLIT_H

#include "store/dataset.h"

typedef struct pm_split {
    int ntraining, nvalidation;
    int *trajectory; // [ntraining + nvalidation] numbers in the dataset, the training part first
    const char *training, *validation; // both parts as lists, such as "0:4,5:9"; "" if empty
} pm_split;

// Chooses both parts among the `count` trajectories of a dataset. `trajectories` is a list of the
// trajectories to use (NULL: all). `validation` is a list of the trajectories to validate on, which
// are then not trained on, or "none". If it is NULL, every fifth trajectory is kept back; fewer
// than five are not split. The arrays live in the arena. PM_EUSAGE (a bad list), PM_ENOMEM.
pm_status pm_split_choose(pm_split *split, int count, const char *trajectories,
                          const char *validation, pm_arena *arena);

// Reorders the states and rates of the dataset such that the training part comes first and the
// validation part follows. All other trajectories are removed from it. PM_ENOMEM.
pm_status pm_split_reorder(const pm_split *split, pm_dataset *dataset);

#endif
