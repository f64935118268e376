// Which trajectories of a dataset are trained on, and which are kept back to validate the training:
// rollouts on them say how good the weights are, and which weights are kept.
#ifndef PM_TRAINER_LEARN_SPLIT_H
#define PM_TRAINER_LEARN_SPLIT_H

#include "store/dataset.h"

typedef struct pm_split {
    int ntraining, nvalidation;
    int *trajectory; // [ntraining + nvalidation] of the dataset, those of training first
    const char *training, *validation; // the two as lists, such as "0:4,5:9"; "" if there are none
} pm_split;

// Chooses among the `count` trajectories of a dataset. `trajectories` is a list of those to use
// (NULL: all). `validation` is a list of those to validate on, which are then not trained on;
// "none"; or NULL: every fifth of those to use, the fifth, the tenth and so on, which leaves fewer
// than five whole. The arrays live in the arena. PM_EUSAGE, PM_ENOMEM.
pm_status pm_split_choose(pm_split *split, int count, const char *trajectories,
                          const char *validation, pm_arena *arena);

// Moves the trajectories of the dataset, states and rates, so that those of training come first and
// those of validation follow; the dataset then has no others. PM_ENOMEM.
pm_status pm_split_reorder(const pm_split *split, pm_dataset *dataset);

#endif
