// Learned constants as parameters and as symbols.
#include "model/constants.h"

#include <math.h>
#include <stdio.h>

static bool is_learned(const pm_constants *c, int i) {
    return c->learned != NULL && c->learned[i] != PM_CONSTANT_KNOWN;
}

pm_status pm_constants_declare(const pm_constants *c, pm_params *params) {
    int count = 0;
    for (int i = 0; c != NULL && i < c->count; ++i) {
        if (!is_learned(c, i)) {
            continue;
        }
        if (++count > PM_MAX_LEARNED) {
            return pm_fail(PM_ECONFIG, "more than %d constants are to be learned", PM_MAX_LEARNED);
        }
        char name[PM_MAX_NAME + 16];
        snprintf(name, sizeof name, PM_CONSTANT_PREFIX "%.*s", PM_MAX_NAME, c->name[i]);
        const double start = c->learned[i] == PM_CONSTANT_POSITIVE ? log(c->value[i]) : c->value[i];
        PM_TRY(c->shared != NULL && c->shared[i]
                   ? pm_params_add_shared(params, name, start)
                   : pm_params_add(params, name, 1, 1, true, 0, start));
    }
    return PM_OK;
}

void pm_constants_add(const pm_constants *c, pm_graph *g, const pm_params *params,
                      pm_symbols *symbols) {
    for (int i = 0; c != NULL && i < c->count; ++i) {
        if (!is_learned(c, i) || symbols->count == PM_MAX_SYMBOLS) {
            continue;
        }
        char name[PM_MAX_NAME + 16];
        snprintf(name, sizeof name, PM_CONSTANT_PREFIX "%.*s", PM_MAX_NAME, c->name[i]);
        const pm_param_entry *entry = g == NULL ? NULL : pm_params_find(params, name);
        pm_node node = entry == NULL ? PM_NO_NODE : pm_weight(g, entry->value, 1, 1);
        if (entry != NULL && c->learned[i] == PM_CONSTANT_POSITIVE) {
            node = pm_exp(g, node);
        }
        pm_symbols_add_one(symbols, c->name[i], 1, node);
    }
}
