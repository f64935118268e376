// Chooses the initial weights of a training by successive halving (Jamieson, Talwalkar, AISTATS
// 2016): several random draws are fitted to derivatives for some iterations of Gauss-Newton, the
// worse half is dropped, and this is repeated until one is left. Products of learned energies and
// operators have poor local minima, which a short fit reveals. The result depends on the seed
// alone.
#ifndef PM_TRAINER_LEARN_START_H
#define PM_TRAINER_LEARN_START_H

#include <signal.h>

#include "learn/samples.h"
#include "learn/training.h"

// Draws random initial weights with the seed of the training. The system must hold the declared
// weights, to which the random numbers are added. Writes all weights to theta [pm_objective_size].
void pm_start_draw(pm_training *training, double *theta);
// Does the same for draw number `id` of a search; number 0 is the one above.
void pm_start_draw_again(pm_training *training, int id, double *theta);

// Replaces theta [size] by the best of training->tries random draws. `seed` decides the draws; if
// it is training->seed, `theta` must be the result of pm_start_draw and is the first of them. The
// loss on `samples`, which must be those of the derivative residual, decides which draw is best.
// `declared` [size] are the declared weights. The constants of the models must have been fixed
// (learn/normalization.h). If training->tries is 1, theta is not changed. PM_EINTERRUPTED if *stop
// becomes nonzero; PM_ENOMEM.
pm_status pm_start_search(pm_training *training, const pm_samples *samples, uint64_t seed,
                          const double *declared, double *theta, const volatile sig_atomic_t *stop);

#endif
