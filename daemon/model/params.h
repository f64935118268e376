// The numbers a component carries: weights that training changes, and constants that it fixes from
// the data before (normalisation, the region seen). Builders of networks name what they need; the
// trainer or a weights file supplies the values.
#ifndef PM_MODEL_PARAMS_H
#define PM_MODEL_PARAMS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/rng.h"
#include "base/status.h"

typedef struct pm_param_entry {
    char *name; // e.g. "energy.1.layer0.weight"
    int rows, cols;
    bool trained;  // false: fixed from the data, not by the optimiser
    double spread; // standard deviation of what pm_params_randomise adds
    double *value; // [rows][cols], stays where it is until pm_params_free
} pm_param_entry;

// Storage the caller owns; zero-initialise.
typedef struct pm_params {
    int count;
    pm_param_entry *entry;
} pm_params;

void pm_params_free(pm_params *params);

// The entry called `name`, or NULL.
pm_param_entry *pm_params_find(const pm_params *params, const char *name);

// Makes the entry called `name`, every value `start`, if it is not there yet. PM_ECONFIG: one of
// another shape has this name; PM_ENOMEM: also, more than 2^24 numbers in all.
pm_status pm_params_add(pm_params *params, const char *name, int rows, int cols, bool trained,
                        double spread, double start);

// PM_ECONFIG: a number that neither training nor data determine was not given (it is not finite).
pm_status pm_params_check_given(const pm_params *params);

// Adds normal numbers to the starting values of all trained entries, in order.
void pm_params_randomise(pm_params *params, pm_rng *rng);

// Number of trained values in all.
size_t pm_params_trained(const pm_params *params);

// Copies all trained values, in order of entries, to or from a flat vector.
void pm_params_gather(const pm_params *params, double *theta);
void pm_params_scatter(pm_params *params, const double *theta);

#endif
