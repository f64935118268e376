// A list of named matrices, each in its own memory so that graphs may keep pointers to the values.
#include "model/params.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// The most numbers of all parameters together. Sizes come from files, which may be wrong; no model
// of this size can be trained, and every host has the memory.
#define MAX_NUMBERS ((size_t)1 << 24)

static size_t entry_size(const pm_param_entry *entry) {
    return (size_t)entry->rows * (size_t)entry->cols;
}

void pm_params_free(pm_params *params) {
    for (int i = 0; i < params->count; ++i) {
        free(params->entry[i].name);
        if (!params->entry[i].borrowed) {
            free(params->entry[i].value);
        }
    }
    free(params->entry);
    *params = (pm_params){0};
}

pm_param_entry *pm_params_find(const pm_params *params, const char *name) {
    for (int i = 0; i < params->count; ++i) {
        if (strcmp(params->entry[i].name, name) == 0) {
            return &params->entry[i];
        }
    }
    return NULL;
}

static pm_param_entry *append(pm_params *params, const char *name, size_t size) {
    pm_param_entry *entry =
        realloc(params->entry, ((size_t)params->count + 1) * sizeof *params->entry);
    if (entry == NULL) {
        return NULL;
    }
    params->entry = entry;
    char *copy = strdup(name);
    double *value = calloc(size, sizeof *value);
    if (copy == NULL || value == NULL) {
        free(copy);
        free(value);
        return NULL;
    }
    entry += params->count++;
    *entry = (pm_param_entry){.name = copy, .value = value};
    return entry;
}

pm_status pm_params_add(pm_params *params, const char *name, int rows, int cols, bool trained,
                        double spread, double start) {
    pm_param_entry *entry = pm_params_find(params, name);
    if (entry != NULL) {
        return entry->rows == rows && entry->cols == cols
                   ? PM_OK
                   : pm_fail(PM_ECONFIG, "parameter %s is %d x %d, expected %d x %d", name,
                             entry->rows, entry->cols, rows, cols);
    }
    size_t total = (size_t)rows * (size_t)cols; // both are below 2^31, so that the product fits
    for (int i = 0; i < params->count && total <= MAX_NUMBERS; ++i) {
        total += entry_size(&params->entry[i]);
    }
    if (total > MAX_NUMBERS) {
        return pm_fail(PM_ENOMEM, "parameter %s (%d x %d): more than %zu numbers in all", name,
                       rows, cols, MAX_NUMBERS);
    }
    entry = append(params, name, (size_t)rows * (size_t)cols);
    PM_TRY(pm_allocated(entry, "parameter %s (%d x %d)", name, rows, cols));
    entry->rows = rows;
    entry->cols = cols;
    entry->trained = trained;
    entry->spread = spread;
    for (size_t i = 0; i < entry_size(entry); ++i) {
        entry->value[i] = start;
    }
    return PM_OK;
}

pm_status pm_params_add_shared(pm_params *params, const char *name, double start) {
    PM_TRY(pm_params_add(params, name, 1, 1, true, 0, start));
    pm_params_find(params, name)->shared = pm_params_find(params, name)->held = true;
    return PM_OK;
}

void pm_params_share(pm_params *params, const pm_params *owner) {
    for (int i = 0; i < params->count; ++i) {
        pm_param_entry *entry = &params->entry[i];
        const pm_param_entry *other = pm_params_find(owner, entry->name);
        if (entry->shared && !entry->borrowed && other != NULL && other->shared) {
            free(entry->value);
            entry->value = other->value;
            entry->borrowed = true;
            entry->trained = false;
        }
    }
}

pm_status pm_params_check_given(const pm_params *params) {
    for (int i = 0; i < params->count; ++i) {
        const pm_param_entry *entry = &params->entry[i];
        for (size_t j = 0; j < entry_size(entry); ++j) {
            if (!isfinite(entry->value[j])) {
                return pm_fail(PM_ECONFIG, "\"%s\" is missing: %d x %d numbers", entry->name,
                               entry->rows, entry->cols);
            }
        }
    }
    return PM_OK;
}

void pm_params_randomise(pm_params *params, pm_rng *rng) {
    for (int i = 0; i < params->count; ++i) {
        pm_param_entry *entry = &params->entry[i];
        for (size_t j = 0; entry->trained && j < entry_size(entry); ++j) {
            entry->value[j] += entry->spread * pm_rng_normal(rng);
        }
    }
}

size_t pm_params_trained(const pm_params *params) {
    size_t count = 0;
    for (int i = 0; i < params->count; ++i) {
        count += params->entry[i].trained ? entry_size(&params->entry[i]) : 0;
    }
    return count;
}

void pm_params_gather(const pm_params *params, double *theta) {
    for (int i = 0; i < params->count; ++i) {
        const pm_param_entry *entry = &params->entry[i];
        if (entry->trained) {
            memcpy(theta, entry->value, entry_size(entry) * sizeof *theta);
            theta += entry_size(entry);
        }
    }
}

void pm_params_scatter(pm_params *params, const double *theta) {
    for (int i = 0; i < params->count; ++i) {
        pm_param_entry *entry = &params->entry[i];
        if (entry->trained) {
            memcpy(entry->value, theta, entry_size(entry) * sizeof *theta);
            theta += entry_size(entry);
        }
    }
}
