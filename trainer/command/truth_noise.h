// Turns simulated trajectories into synthetic measurements, with noise and missing samples.
#ifndef PM_TRAINER_COMMAND_TRUTH_NOISE_H
#define PM_TRAINER_COMMAND_TRUTH_NOISE_H

#include "store/dataset.h"

// Adds normally distributed noise to every column of the dataset. Its standard deviation is `noise`
// times that of the column over all trajectories. Then leaves out the fraction `missing` of all
// states at random, so that the remaining times are uneven. The result depends on the seed and on
// the number of each trajectory, which is `first` for the first one. PM_ENOMEM.
pm_status pm_truth_add_noise(pm_dataset *dataset, int first, double noise, double missing,
                             int seed);

#endif
