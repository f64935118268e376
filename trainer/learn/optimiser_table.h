// The optimisers themselves, for the table alone.
#ifndef PM_TRAINER_LEARN_OPTIMISER_TABLE_H
#define PM_TRAINER_LEARN_OPTIMISER_TABLE_H

#include "learn/optimiser.h"

// Kingma, Ba, Adam: a method for stochastic optimization, ICLR 2015.
pm_status pm_adam_run(pm_optimisation *optimisation);
// Liu, Nocedal, Math. Program. 45 (1989) 503, by the library libLBFGS; all samples at once.
pm_status pm_lbfgs_run(pm_optimisation *optimisation);

// Levenberg-Marquardt on batches of samples.
pm_status pm_gauss_newton_run(pm_optimisation *optimisation);

#endif
