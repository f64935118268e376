// Reads operators: given pairs and the learned matrix.
#include <math.h>

#include "scene/model_block.h"
#include "scene/network_reader.h"

#define MAX_RANK 64

// Reads a coefficient, which is a number or a formula.
static pm_status read_coefficient(pm_yaml value, const pm_model_context *r, pm_given_pair *pair) {
    return pm_yaml_double(value, -INFINITY, INFINITY, &pair->coefficient) == PM_OK
               ? PM_OK
               : pm_model_read_formula(value, r, &pair->formula);
}

static pm_status read_pairs(pm_yaml list, const pm_model_context *r, pm_operator_spec *op) {
    if (!pm_yaml_is_list(list)) {
        return pm_yaml_fail(list, "expected a list of pairs such as [[q, p, 1.0]]");
    }
    const int count = pm_yaml_count(list);
    pm_given_pair *pair = pm_arena_array(r->arena, (size_t)count, sizeof *pair);
    if (pair == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < count; ++i) {
        const pm_yaml item = pm_yaml_item(list, i);
        if (!pm_yaml_is_list(item) || pm_yaml_count(item) != 3) {
            return pm_yaml_fail(item, "expected a pair such as [q, p, 1.0]: row, column, "
                                      "coefficient");
        }
        PM_TRY(pm_yaml_text(pm_yaml_item(item, 0), r->arena, &pair[i].row));
        PM_TRY(pm_yaml_text(pm_yaml_item(item, 1), r->arena, &pair[i].col));
        pair[i].cross = pm_yaml_is_text(pm_yaml_item(item, 2), "cross");
        PM_TRY(pair[i].cross ? PM_OK : read_coefficient(pm_yaml_item(item, 2), r, &pair[i]));
    }
    op->given = pair;
    op->ngiven = count;
    return PM_OK;
}

// Reads the network of the strengths of the processes.
static pm_status read_strength(pm_yaml block, const pm_model_context *r, pm_operator_spec *op) {
    static const char *const keys[] = {"features", "hidden", "activation", "skip", NULL};
    if (!pm_yaml_exists(block)) {
        return PM_OK;
    }
    pm_network_spec *strength = pm_arena_alloc(r->arena, sizeof *strength);
    if (strength == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_network_read(block, r->arena, strength));
    if (strength->nfeature == 0) {
        return pm_yaml_fail(block, "a strength needs features");
    }
    op->strength = strength;
    return PM_OK;
}

static pm_status read_learned(pm_yaml block, const pm_model_context *r, bool reversible,
                              pm_operator_spec *op) {
    static const char *const reversible_keys[] = {"acts_on", "against", "along", PM_NETWORK_KEYS,
                                                  NULL};
    static const char *const irreversible_keys[] = {"acts_on",  "along",         "rank", "heats",
                                                    "strength", PM_NETWORK_KEYS, NULL};
    pm_yaml acts;
    PM_TRY(pm_yaml_allow(block, reversible ? reversible_keys : irreversible_keys));
    PM_TRY(pm_yaml_require(block, "acts_on", &acts));
    PM_TRY(pm_model_read_names(block, "acts_on", r->arena, &op->nacts, &op->acts_on));
    if (op->nacts == 0) {
        return pm_yaml_fail(acts, "expected at least one group");
    }
    PM_TRY(pm_model_read_names(block, "against", r->arena, &op->nagainst, &op->against));
    PM_TRY(pm_model_read_names(block, "along", r->arena, &op->nalong, &op->along));
    if (pm_yaml_exists(pm_yaml_get(block, "heats"))) {
        PM_TRY(pm_model_read_names(block, "heats", r->arena, &op->nheats, &op->heats));
    }
    op->rank = reversible ? 0 : 1;
    const pm_yaml rank = pm_yaml_get(block, "rank");
    if (pm_yaml_exists(rank)) {
        PM_TRY(pm_yaml_int(rank, 1, MAX_RANK, &op->rank));
    }
    op->learned = true;
    PM_TRY(read_strength(pm_yaml_get(block, "strength"), r, op));
    return pm_network_read(block, r->arena, &op->network);
}

pm_status pm_model_read_operator(pm_yaml block, const pm_model_context *r, bool reversible,
                                 pm_operator_spec *op) {
    static const char *const keys[] = {"given", "learned", "heats", NULL};
    *op = (pm_operator_spec){0};
    if (pm_model_is_none(block)) {
        return PM_OK;
    }
    PM_TRY(pm_model_read_at(block, r->arena, &op->at));
    PM_TRY(pm_yaml_allow(block, keys));
    const pm_yaml given = pm_yaml_get(block, "given");
    if (pm_yaml_exists(given)) {
        PM_TRY(read_pairs(given, r, op));
    }
    const pm_yaml heats = pm_yaml_get(block, "heats");
    if (pm_yaml_exists(heats)) {
        if (reversible) {
            return pm_yaml_fail(heats, "only an irreversible operator heats");
        }
        PM_TRY(pm_model_read_names(block, "heats", r->arena, &op->nheats, &op->heats));
    }
    const pm_yaml learned = pm_yaml_get(block, "learned");
    return pm_model_is_none(learned) ? PM_OK : read_learned(learned, r, reversible, op);
}
