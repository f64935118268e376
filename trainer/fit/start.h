// Chooses the initial weights of a training by successive halving (optimise/successive_halving.h)
// of random draws, which are fitted to derivatives by Gauss-Newton. Products of learned energies
// and operators have poor local minima, which a short fit reveals. The result depends on the seed
// alone.
#ifndef PM_TRAINER_FIT_START_H
#define PM_TRAINER_FIT_START_H

#include <signal.h>

#include "data/samples.h"
#include "fit/training.h"

// Draws random initial weights with the seed of the training. The system must hold the declared
// weights, to which the random numbers are added. Writes all weights to theta [pm_trained_count].
// `id` numbers the draws of a search, from 0 on.
void pm_start_draw(pm_training *training, int id, double *theta);

// Replaces theta [size] by the best of training->tries random draws. `seed` decides the draws; if
// it is training->seed, `theta` must be the result of pm_start_draw and is the first of them. The
// loss on `samples`, which must be those of the derivative residual, decides which draw is best.
// `declared` [size] are the declared weights. The constants of the models must have been fixed
// (fit/normalization.h). *loss becomes its loss, the mean square of the residuals. If
// training->tries is 1, neither is changed. PM_EINTERRUPTED if *stop becomes nonzero; PM_ENOMEM.
pm_status pm_start_search(pm_training *training, const pm_samples *samples, uint64_t seed,
                          const double *declared, double *theta, double *loss,
                          const volatile sig_atomic_t *stop);

#endif
