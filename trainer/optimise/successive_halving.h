// Successive halving (Jamieson, Talwalkar, AISTATS 2016): several candidates are fitted for some
// iterations, the worse half is dropped, and this is repeated with half as many iterations more
// until one is left.
#ifndef PM_TRAINER_OPTIMISE_SUCCESSIVE_HALVING_H
#define PM_TRAINER_OPTIMISE_SUCCESSIVE_HALVING_H

#include "base/status.h"

typedef struct pm_successive_halving {
    int count;      // candidates at first
    int iterations; // of each candidate in the first round
    // Fits candidate `id` for some iterations while `left` are in the race, and writes its score,
    // of which smaller is better; INFINITY drops it.
    pm_status (*advance)(void *context, int id, int left, int iterations, double *score);
    void *context;
} pm_successive_halving;

// Writes the number of the best candidate and its score. Fails as `advance` does; PM_ENOMEM.
pm_status pm_successive_halving_run(const pm_successive_halving *how, int *best, double *score);
// Returns the number of iterations of all candidates in all rounds.
int pm_successive_halving_iterations(const pm_successive_halving *how);

#endif
