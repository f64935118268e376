// The interface of optimisers. Each is one function and one line in the table of optimiser.c.
#ifndef PM_TRAINER_OPTIMISE_OPTIMISER_H
#define PM_TRAINER_OPTIMISE_OPTIMISER_H

#include <stdint.h>

#include "loss/objective.h"

// The settings of an optimiser in one stage. Each optimiser reads those that name it.
typedef struct pm_schedule {
    int iterations;               // adam: the number of epochs
    int batch;                    // adam, gauss_newton: samples per update
    double first_rate, last_rate; // adam: learning rate, decreasing along a half cosine
    double beta2;                 // adam: decay of the mean square of the gradients
    double decay;                 // adam: the fraction of a weight lost per update, over the rate
    int memory;                   // lbfgs: the number of stored correction pairs
    // gauss_newton: a step must lower the loss of further samples, too, and the run ends before its
    // last iteration if the loss does not fall any more
    bool guarded;
    // gauss_newton: steps are accelerated in the end (normal_equations.h), and a guarded run ends
    // only when it has settled on all samples. What this finds in the end costs more at first.
    bool thorough;
    // gauss_newton: weights as late as this or later stay as they are; PM_AT_ONCE: none
    pm_lateness early;
} pm_schedule;

// A training stage in progress. A stage can be interrupted whenever it reports, and can be resumed
// from theta, moment, done, batches and loss.
typedef struct pm_optimisation {
    pm_objective *objective; // borrowed
    pm_schedule schedule;
    uint64_t seed;  // decides the batches
    double *theta;  // [pm_objective_size] initial weights and result
    double *moment; // [2][pm_objective_size] the memory of the optimiser; zero at first
    int done;       // completed iterations
    int batches;    // adam: completed batches of the iteration in progress
    double loss;    // adam: the sum of the losses of the samples in these batches
    // Called after every iteration, and by adam after every batch, with theta up to date. The stage
    // ends if it returns anything but PM_OK.
    pm_status (*report)(void *context, const struct pm_optimisation *optimisation, double loss);
    void *context;
} pm_optimisation;

typedef struct pm_optimiser {
    const char *name;
    // Minimises the loss in the remaining iterations. Returns the status of `report`, PM_ENUMERIC
    // if the loss is not finite, or PM_ENOMEM.
    pm_status (*run)(pm_optimisation *optimisation);
    bool least_squares; // an iteration takes a batch, and differentiates each of its residuals
} pm_optimiser;

// Returns the optimiser with this name, or NULL.
const pm_optimiser *pm_optimiser_find(const char *name);
// Returns the names of all optimisers, separated by commas, for error messages.
const char *pm_optimiser_names(void);

#endif
