// The numbers of a component: weights, which training changes, and constants, which training fixes
// from the data before it changes weights (normalisation, training range). The functions that
// declare a model name the parameters that they need; the trainer or a weights file supplies the
// values.
#ifndef PM_MODEL_PARAMS_H
#define PM_MODEL_PARAMS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/rng.h"
#include "base/status.h"

// When training begins to change an entry.
typedef enum pm_lateness {
    PM_AT_ONCE,     // from the start
    PM_LATE,        // after it has compared several initial weights
    PM_LATE_LAYERS, // after it has fitted the best of them, with entries that are PM_LATE
} pm_lateness;

typedef struct pm_param_entry {
    char *name; // e.g. "energy.1.layer0.weight"
    int rows, cols;
    bool trained; // true: the optimiser changes it; false: it is fixed from the data
    pm_lateness late;
    double spread; // standard deviation of the numbers that pm_params_randomise adds
    double *value; // [rows][cols], owned unless borrowed; the pointer stays valid until
                   // pm_params_free
    bool shared;   // the entries of this name in all components of a system are one weight
    bool shrinks;  // training lets it shrink where the data do not need it (normal_equations.h)
    bool held;     // training damps its steps until the loss is small (optimise/normal_equations.h)
    bool borrowed; // the value belongs to the entry of another component, which is trained
} pm_param_entry;

// The caller owns this storage, initialises it with zeros and frees it with pm_params_free.
typedef struct pm_params {
    int count;
    pm_param_entry *entry;
} pm_params;

void pm_params_free(pm_params *params);

// Returns the entry called `name`, or NULL.
pm_param_entry *pm_params_find(const pm_params *params, const char *name);

// Adds an entry of this name and shape whose values are all `start`; an entry of this name that
// exists already is left as it is. PM_ECONFIG: the existing entry has another shape. PM_ENOMEM:
// memory runs out, or all entries together would have more than 2^24 numbers.
pm_status pm_params_add(pm_params *params, const char *name, int rows, int cols, bool trained,
                        double spread, double start);

// Does the same for one number that is trained, and shared by all components of a system.
pm_status pm_params_add_shared(pm_params *params, const char *name, double start);

// Makes the shared entries of `params` borrow the values of the entries of the same names in
// `owner`, which must live longer. They are then no longer trained themselves.
void pm_params_share(pm_params *params, const pm_params *owner);

// Checks that all numbers are finite. A number that must be given by the user is NaN until it is
// given. PM_ECONFIG.
pm_status pm_params_check_given(const pm_params *params);

// Adds normally distributed random numbers with the standard deviation `spread` to the values of
// all trained entries, in order.
void pm_params_randomise(pm_params *params, pm_rng *rng);

// Returns the number of values of all trained entries.
size_t pm_params_trained(const pm_params *params);

// Copy all trained values, in the order of entries, to or from theta [pm_params_trained].
void pm_params_gather(const pm_params *params, double *theta);
void pm_params_scatter(pm_params *params, const double *theta);

#endif
