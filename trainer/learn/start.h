// Where a training starts: several draws of the weights are fitted to derivatives for some
// iterations of Gauss-Newton, the worse half is dropped, and so on until one is left (successive
// halving: Jamieson, Talwalkar, AISTATS 2016). Products of learned energies and operators have poor
// local minima, of which a short fit tells; the result depends on the seed alone.
#ifndef PM_TRAINER_LEARN_START_H
#define PM_TRAINER_LEARN_START_H

#include <signal.h>

#include "learn/samples.h"
#include "learn/training.h"

// The seed's own draw of all weights, which are as declared before. theta: [size], all trained
// numbers.
void pm_start_draw(pm_training *training, double *theta);

// Moves theta, drawn before and normalised, to the best of training->tries starts by their loss on
// the samples, which are of derivatives. Nothing to do with one try. A signal ends it with
// PM_EINTERRUPTED.
pm_status pm_start_search(pm_training *training, const pm_samples *samples, const double *declared,
                          double *theta, const volatile sig_atomic_t *stop);

#endif
