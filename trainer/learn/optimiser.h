// Optimisers: one file each and one line in the table of learn/optimiser.c.
#ifndef PM_TRAINER_LEARN_OPTIMISER_H
#define PM_TRAINER_LEARN_OPTIMISER_H

#include <stdint.h>

#include "learn/objective.h"

typedef struct pm_schedule {
    int iterations;               // adam: epochs
    int batch;                    // adam, gauss_newton: samples per update
    double first_rate, last_rate; // adam: learning rate, falling along a cosine
    double beta2;                 // adam: how much of the mean square of gradients stays
    int memory;                   // lbfgs: pairs kept
    bool guarded; // gauss_newton: a step that the next batch shows to be wild is undone
} pm_schedule;

// One stage of a training under way. A stage can be left whenever it reports and taken up again
// from theta, moment, done, batches and loss.
typedef struct pm_optimisation {
    pm_objective *objective;
    pm_schedule schedule;
    uint64_t seed;  // of the shuffling
    double *theta;  // [pm_objective_size] start and result
    double *moment; // [2][pm_objective_size] what the optimiser remembers; zero at first
    int done;       // iterations finished
    int batches;    // adam: of the next one that are finished,
    double loss;    // and the sum of their samples' losses
    // Called after every iteration, and after every batch of one, with theta up to date; anything
    // but PM_OK ends the stage.
    pm_status (*report)(void *context, const struct pm_optimisation *optimisation, double loss);
    void *context;
} pm_optimisation;

typedef struct pm_optimiser {
    const char *name;
    pm_status (*run)(pm_optimisation *optimisation);
} pm_optimiser;

// The optimiser called `name`, or NULL; _names lists all.
const pm_optimiser *pm_optimiser_find(const char *name);
const char *pm_optimiser_names(void);

#endif
