// The table of optimisers.
#include "learn/optimiser_table.h"

#include <stddef.h>
#include <string.h>

static const pm_optimiser optimisers[] = {
    {"adam", pm_adam_run},
    {"lbfgs", pm_lbfgs_run},
    {"gauss_newton", pm_gauss_newton_run},
    {"gauss_newton_cg", pm_gauss_newton_cg_run},
};

const pm_optimiser *pm_optimiser_find(const char *name) {
    for (size_t i = 0; i < sizeof optimisers / sizeof *optimisers; ++i) {
        if (strcmp(optimisers[i].name, name) == 0) {
            return &optimisers[i];
        }
    }
    return NULL;
}

const char *pm_optimiser_names(void) {
    return "adam, lbfgs, gauss_newton, gauss_newton_cg";
}
