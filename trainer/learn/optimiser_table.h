// The functions of all optimisers, for the table in learn/optimiser.c.
#ifndef PM_TRAINER_LEARN_OPTIMISER_TABLE_H
#define PM_TRAINER_LEARN_OPTIMISER_TABLE_H

#include "learn/optimiser.h"

// Adam on shuffled batches (Kingma, Ba, Adam: a method for stochastic optimization, ICLR 2015).
pm_status pm_adam_run(pm_optimisation *optimisation);
// L-BFGS on all samples at once (Liu, Nocedal, Math. Program. 45 (1989) 503), by the library
// libLBFGS.
pm_status pm_lbfgs_run(pm_optimisation *optimisation);
// Levenberg-Marquardt on batches (Marquardt, J. SIAM 11 (1963) 431), with the matrix of the normal
// equations where it is small, and by conjugate gradients without a matrix where it would be large.
pm_status pm_gauss_newton_run(pm_optimisation *optimisation);
// Levenberg-Marquardt by conjugate gradients, for any number of weights (Martens, ICML 2010).
pm_status pm_gauss_newton_cg_run(pm_optimisation *optimisation);

#endif
