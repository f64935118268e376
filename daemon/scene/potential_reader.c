// Reads energies and entropies: formulas, linear forms and networks.
#include <math.h>

#include "scene/model_block.h"
#include "scene/network_reader.h"

// Reads entry i of a linear form: the name of a group, or "group: coefficient".
static pm_status read_given_entry(pm_yaml given, int i, pm_arena *arena, const char **group,
                                  double *coefficient) {
    *coefficient = 1;
    if (!pm_yaml_is_map(given)) {
        return pm_yaml_text(pm_yaml_is_list(given) ? pm_yaml_item(given, i) : given, arena, group);
    }
    pm_yaml key, value;
    pm_yaml_entry(given, i, &key, &value);
    PM_TRY(pm_yaml_text(key, arena, group));
    return pm_yaml_double(value, -INFINITY, INFINITY, coefficient);
}

// Adds a linear form to a potential: a group, a list of groups, or a mapping to coefficients.
static pm_status read_given(pm_yaml given, pm_arena *arena, pm_potential_spec *potential) {
    const int before = potential->ngiven;
    const bool one = !pm_yaml_is_map(given) && !pm_yaml_is_list(given);
    const int total = before + (one ? 1 : pm_yaml_count(given));
    const char **group = pm_arena_array(arena, (size_t)total, sizeof *group);
    double *coefficient = pm_arena_array(arena, (size_t)total, sizeof *coefficient);
    if (group == NULL || coefficient == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < total; ++i) {
        if (i < before) {
            group[i] = potential->given[i];
            coefficient[i] = potential->given_coefficient[i];
        } else {
            PM_TRY(read_given_entry(given, i - before, arena, &group[i], &coefficient[i]));
        }
    }
    potential->given = group;
    potential->given_coefficient = coefficient;
    potential->ngiven = total;
    return PM_OK;
}

// Reads the keys of a thermal energy. Its entropies become the last features of the network.
static pm_status read_thermal(pm_yaml item, pm_arena *arena, pm_network_spec *term) {
    const pm_yaml thermal = pm_yaml_get(item, "thermal"), scaled = pm_yaml_get(item, "scaled");
    const pm_yaml count = pm_yaml_get(item, "exponentials"),
                  start = pm_yaml_get(item, "temperature"),
                  separate = pm_yaml_get(item, "separate");
    if (pm_yaml_exists(scaled)) {
        PM_TRY(pm_yaml_bool(scaled, &term->scaled));
    }
    // Without `thermal` the physical defaults of training may still make the energy thermal.
    if (pm_yaml_exists(count)) {
        PM_TRY(pm_yaml_int(count, 1, PM_MAX_EXPONENTIALS, &term->exponentials));
    }
    if (pm_yaml_exists(start)) {
        PM_TRY(pm_yaml_double(start, 1e-300, 1e300, &term->temperature));
    }
    if (pm_yaml_exists(separate)) {
        PM_TRY(pm_yaml_bool(separate, &term->separate));
    }
    if (!pm_yaml_exists(thermal)) {
        return PM_OK;
    }
    const char *const *entropy;
    PM_TRY(pm_model_read_names(item, "thermal", arena, &term->nthermal, &entropy));
    if (term->nthermal < 1 || term->nthermal + term->nfeature > PM_MAX_FEATURES) {
        return pm_yaml_fail(thermal, "expected 1 to %d entropies",
                            PM_MAX_FEATURES - term->nfeature);
    }
    term->exponentials = term->exponentials > 0 ? term->exponentials : PM_DEFAULT_EXPONENTIALS;
    term->temperature = term->temperature > 0 ? term->temperature : PM_DEFAULT_TEMPERATURE;
    term->scaled = true;
    return pm_spec_append_features(term, term->nthermal, entropy, arena);
}

// Reads a network. With `zero_at_origin` the output and its slope vanish where all features are
// zero.
static pm_status read_term(pm_yaml item, const pm_model_context *r, pm_network_spec *term) {
    static const char *const keys[] = {
        PM_NETWORK_KEYS, "zero_at_origin", "thermal",  "exponentials",
        "temperature",   "scaled",         "separate", NULL};
    const pm_yaml zero_at_origin = pm_yaml_get(item, "zero_at_origin");
    PM_TRY(pm_yaml_allow(item, keys));
    PM_TRY(pm_network_read(item, r->arena, term));
    PM_TRY(read_thermal(item, r->arena, term));
    if (pm_yaml_exists(zero_at_origin)) {
        PM_TRY(pm_yaml_bool(zero_at_origin, &term->zero_at_origin));
    }
    const bool able = term->nfeature > 0 && term->nthermal == 0 && term->skip != PM_SKIP_NONE;
    return able || !term->zero_at_origin
               ? PM_OK
               : pm_yaml_fail(zero_at_origin,
                              "only a network of features with a skip can be zero at the origin");
}

// Adds one summand to a potential; `formulas` and `terms` have room for it.
static pm_status read_summand(pm_yaml item, const pm_model_context *r, pm_potential_spec *potential,
                              pm_formula *formulas, pm_network_spec *terms) {
    static const char *const given_keys[] = {"given", NULL};
    if (!pm_yaml_is_map(item)) {
        return pm_model_read_formula(item, r, &formulas[potential->nformula++]);
    }
    if (!pm_yaml_exists(pm_yaml_get(item, "given"))) {
        return read_term(item, r, &terms[potential->nterm++]);
    }
    PM_TRY(pm_yaml_allow(item, given_keys));
    return read_given(pm_yaml_get(item, "given"), r->arena, potential);
}

pm_status pm_model_read_potential(pm_yaml value, const pm_model_context *r,
                                  pm_potential_spec *potential) {
    *potential = (pm_potential_spec){0};
    if (pm_model_is_none(value)) {
        return PM_OK;
    }
    PM_TRY(pm_model_read_at(value, r->arena, &potential->at));
    const int count = pm_yaml_is_list(value) ? pm_yaml_count(value) : 1;
    pm_network_spec *terms = pm_arena_array(r->arena, (size_t)count, sizeof *terms);
    pm_formula *formulas = pm_arena_array(r->arena, (size_t)count, sizeof *formulas);
    if (terms == NULL || formulas == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    potential->term = terms;
    potential->formula = formulas;
    for (int i = 0; i < count; ++i) {
        PM_TRY(read_summand(pm_yaml_is_list(value) ? pm_yaml_item(value, i) : value, r, potential,
                            formulas, terms));
    }
    return PM_OK;
}
