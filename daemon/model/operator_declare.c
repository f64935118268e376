// Checks an operator's spec, declares its parameters, and visits the constants that training fixes.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/dissipation.h"
#include "model/given.h"
#include "model/operator_shape.h"

// The initial entries of the factor of a learned M have this magnitude. At zero the factor would
// have no gradient. The signs of its rows alternate, since the projection removes what all rows
// have in common.
#define FACTOR_START 1.0
// A constant conductance starts from this magnitude: too large a one falls in one iteration, but
// one that is too small can only grow while all temperature differences shrink.
#define CONDUCTION_START 5.0
#define MAX_ENTRIES (1 << 24) // of a learned matrix

bool pm_operator_exists(const pm_operator_spec *spec) {
    return spec->ngiven > 0 || spec->learned;
}

static pm_status check_heats(const pm_operator *op, const pm_site *site) {
    const pm_operator_spec *spec = op->spec;
    if (spec->nheats == 0 && spec->strength != NULL) {
        return pm_fail(PM_ECONFIG, "%s: strength belongs to an operator with heats", op->prefix);
    }
    if (spec->nheats == 0 || !spec->learned) {
        return PM_OK;
    }
    if (op->form != PM_HARD) {
        return pm_fail(PM_ECONFIG, "%s: heats belongs to form: hard", op->prefix);
    }
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    for (int i = 0; i < s.ngroup; ++i) {
        if (s.learned[i]) {
            return pm_support_heats(spec, site) <= PM_MAX_HEATS
                       ? PM_OK
                       : pm_fail(PM_ECONFIG, "%s: at most %d components can take up heat",
                                 op->prefix, PM_MAX_HEATS);
        }
    }
    return pm_fail(PM_ECONFIG, "%s: a single entropy has nothing to exchange heat with",
                   op->prefix);
}

static pm_status check_groups(const pm_operator *op, const pm_site *site) {
    const pm_operator_spec *spec = op->spec;
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    for (int i = 0; i < spec->nacts; ++i) {
        if (pm_support_find(&s, spec->acts_on[i]) == s.ngroup) {
            return pm_fail(PM_ECONFIG, "%s: acts_on names \"%s\", which is not a group here",
                           op->prefix, spec->acts_on[i]);
        }
    }
    for (int i = 0; i < spec->nheats; ++i) {
        if (pm_support_find(&s, spec->heats[i]) == s.ngroup) {
            return pm_fail(PM_ECONFIG, "%s: heats names \"%s\", which is not a group here",
                           op->prefix, spec->heats[i]);
        }
    }
    PM_TRY(check_heats(op, site));
    for (int i = 0; i < spec->nagainst; ++i) {
        if (pm_support_find(&s, spec->against[i]) == s.ngroup) {
            return pm_fail(PM_ECONFIG, "%s: against names \"%s\", which is not a group here",
                           op->prefix, spec->against[i]);
        }
        if (pm_is_listed(spec->nacts, spec->acts_on, spec->against[i])) {
            return pm_fail(PM_ECONFIG, "%s: against names \"%s\", as acts_on does", op->prefix,
                           spec->against[i]);
        }
    }
    return pm_given_check(spec, op->kind == PM_REVERSIBLE, site, op->prefix);
}

static pm_status check_formulas(const pm_operator_spec *spec, const pm_site *site) {
    for (int i = 0; i < spec->ngiven; ++i) {
        if (spec->given[i].formula.text != NULL) {
            PM_TRY(pm_formula_check(&spec->given[i].formula, &site->symbols));
        }
    }
    return PM_OK;
}

static pm_status check_along(const pm_operator *op, const pm_site *site, const pm_support *s) {
    const pm_operator_spec *spec = op->spec;
    int total = 0;
    PM_TRY(pm_features_size(spec->nalong, spec->along, &site->symbols, &total));
    for (int k = 0; k < spec->nalong; ++k) {
        int size = 0;
        PM_TRY(pm_feature_size(spec->along[k], &site->symbols, &size));
        if (size * spec->nalong != total) {
            return pm_fail(PM_ECONFIG, "%s: the vectors of along differ in size: \"%s\" has %d",
                           op->prefix, spec->along[k], size);
        }
        for (int i = 0; i < s->ngroup; ++i) {
            if (s->learned[i] && s->group[i]->size > 1 && s->group[i]->size != size) {
                return pm_fail(PM_ECONFIG, "%s: \"%s\" has %d components, %s has %d", op->prefix,
                               spec->along[k], size, s->group[i]->name, s->group[i]->size);
            }
        }
    }
    return PM_OK;
}

// Adds trained numbers that start at zero. Far from good weights they would only go astray, because
// the rates hardly depend on them there.
static pm_status add_late(pm_params *params, const char *name, int rows, int columns) {
    PM_TRY(pm_params_add(params, name, rows, columns, true, 0, 0));
    pm_params_find(params, name)->late = true;
    return PM_OK;
}

// Declares the network of the strengths. Its outputs start at zero, so that all strengths are 1.
static pm_status declare_strength(const pm_operator *op, const pm_site *site, pm_params *params) {
    const pm_operator_spec *spec = op->spec;
    pm_operator_name name, output;
    pm_operator_join(name, op->prefix, "strength");
    const size_t length = strlen(name);
    PM_TRY(pm_network_declare(spec->strength, &site->symbols, spec->rank, NULL, params, name));
    pm_param_entry *weight =
        pm_params_find(params, pm_operator_join(output, name, "output.weight"));
    if (weight != NULL) {
        weight->spread = 0;
    }
    for (int i = 0; i < params->count; ++i) {
        pm_param_entry *entry = &params->entry[i];
        entry->late = entry->late || (entry->trained && strncmp(entry->name, name, length) == 0 &&
                                      entry->name[length] == '.');
    }
    return PM_OK;
}

// Declares the shares of the heat of each process, and the exponents of its dependence on
// temperature.
static pm_status declare_split(const pm_operator *op, const pm_site *site, pm_params *params) {
    const int nheat = pm_support_heats(op->spec, site), rank = op->spec->rank;
    pm_operator_name name;
    PM_TRY(pm_params_add(params, pm_operator_join(name, op->prefix, "temperature"), 1, 1, false, 0,
                         PM_DEFAULT_TEMPERATURE));
    PM_TRY(pm_params_add_shared(params, PM_WARMTH, 0));
    PM_TRY(add_late(params, pm_operator_join(name, op->prefix, "power"), 1, rank));
    PM_TRY(op->spec->strength == NULL ? PM_OK : declare_strength(op, site, params));
    if (nheat < 2) {
        return PM_OK;
    }
    PM_TRY(add_late(params, pm_operator_join(name, op->prefix, "ratio_power"), 1, rank));
    return add_late(params, pm_operator_join(name, op->prefix, "split"), rank, nheat - 1);
}

// Whether an operator acts on the entropies alone that take up the heat. Other operators with
// `heats` start from the numbers that the spread of the network draws.
static bool only_conducts(const pm_operator_spec *spec) {
    int count = 0;
    for (int i = 0; i < spec->nacts; ++i) {
        count += pm_is_listed(spec->nheats, spec->heats, spec->acts_on[i]);
    }
    return count > 0 && count == spec->nacts;
}

static pm_status declare_matrix(const pm_operator *op, const pm_site *site, const pm_support *s,
                                pm_params *params) {
    pm_operator_name name;
    pm_operator_join(name, op->prefix, "matrix");
    const pm_network_spec *network = &op->spec->network;
    const pm_operator_shape shape = pm_operator_shape_of(op, s);
    if ((int64_t)shape.rows * shape.columns > MAX_ENTRIES) {
        return pm_spec_locate(op->spec->at,
                              pm_fail(PM_ECONFIG,
                                      "%s: a learned matrix of %d x %d, at most %d "
                                      "entries are possible",
                                      op->prefix, shape.rows, shape.columns, MAX_ENTRIES));
    }
    const int nout = shape.rows * shape.columns;
    if (op->spec->nheats > 0) {
        PM_TRY(declare_split(op, site, params));
    }
    if (op->kind == PM_REVERSIBLE) {
        return pm_network_declare(network, &site->symbols, nout, NULL, params, name);
    }
    double *start = malloc((size_t)nout * sizeof *start);
    if (start == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an operator");
    }
    const double size = op->spec->nheats == 0      ? 1
                        : !only_conducts(op->spec) ? 0
                        : network->nfeature == 0   ? CONDUCTION_START
                                                   : 1;
    for (int i = 0; i < nout; ++i) {
        const double alternating = i / op->spec->rank % 2 == 0 ? FACTOR_START : -FACTOR_START;
        start[i] = size * alternating;
    }
    const pm_status status = pm_network_declare(network, &site->symbols, nout, start, params, name);
    free(start);
    return status;
}

// Lets the learned coefficients of lossless pairs wait until initial weights have been chosen. An
// energy that is larger by a factor, with a coefficient that is smaller by it, moves all but the
// heat as before, so that the coefficients would go astray while the energy is far from its place.
static void hold_coefficients(const pm_operator *op, pm_params *params) {
    for (int k = 0; k < op->spec->ngiven && op->kind == PM_REVERSIBLE; ++k) {
        const pm_formula *formula = &op->spec->given[k].formula;
        const pm_constants *constants = formula->text == NULL ? NULL : formula->constants;
        for (int i = 0; constants != NULL && i < constants->count; ++i) {
            char name[PM_MAX_NAME + 16];
            snprintf(name, sizeof name, "constant.%.*s", PM_MAX_NAME, constants->name[i]);
            pm_param_entry *entry = pm_params_find(params, name);
            if (entry != NULL && strstr(formula->text, constants->name[i]) != NULL) {
                entry->late = true;
            }
        }
    }
}

pm_status pm_operator_declare(const pm_operator *op, const pm_site *site, pm_params *params) {
    const pm_operator_spec *spec = op->spec;
    if (!pm_operator_exists(spec)) {
        return PM_OK;
    }
    PM_TRY(pm_spec_locate(spec->at, check_groups(op, site)));
    PM_TRY(check_formulas(spec, site));
    hold_coefficients(op, params);
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    PM_TRY(pm_spec_locate(spec->at, check_along(op, site, &s)));
    pm_operator_name name;
    PM_TRY(pm_params_add(params, pm_operator_join(name, op->prefix, "scale"), 1, s.n, false, 0, 1));
    if (spec->nalong > 0) {
        pm_operator_join(name, op->prefix, "along");
        PM_TRY(pm_params_add(params, name, 1, spec->nalong, false, 0, 1));
    }
    return spec->learned ? declare_matrix(op, site, &s, params) : PM_OK;
}

pm_status pm_operator_visit(const pm_operator *op, const pm_site *site, pm_normaliser_visit *visit,
                            void *context) {
    const pm_operator_spec *spec = op->spec;
    if (!pm_operator_exists(spec)) {
        return PM_OK;
    }
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    const char *group[2 * PM_MAX_GROUPS];
    for (int i = 0; i < s.ngroup; ++i) {
        group[i] = s.group[i]->name;
    }
    const pm_normaliser scale = {.kind = op->kind == PM_REVERSIBLE ? PM_NORMALISE_SCALE
                                                                   : PM_NORMALISE_FRICTION,
                                 .prefix = op->prefix,
                                 .count = s.ngroup,
                                 .expression = group,
                                 .symbols = &site->symbols,
                                 .nheats = spec->nheats,
                                 .heats = spec->heats};
    PM_TRY(visit(context, &scale));
    if (spec->nalong > 0) {
        const pm_normaliser along = {.kind = PM_NORMALISE_ALONG,
                                     .prefix = op->prefix,
                                     .count = spec->nalong,
                                     .expression = spec->along,
                                     .symbols = &site->symbols};
        PM_TRY(visit(context, &along));
    }
    pm_operator_name name;
    if (spec->strength != NULL) {
        const pm_normaliser strength = {.kind = PM_NORMALISE_FEATURES,
                                        .prefix = pm_operator_join(name, op->prefix, "strength"),
                                        .count = spec->strength->nfeature,
                                        .expression = spec->strength->feature,
                                        .symbols = &site->symbols};
        PM_TRY(visit(context, &strength));
    }
    if (spec->learned && spec->network.nfeature > 0) {
        const pm_normaliser features = {.kind = PM_NORMALISE_FEATURES,
                                        .prefix = pm_operator_join(name, op->prefix, "matrix"),
                                        .count = spec->network.nfeature,
                                        .expression = spec->network.feature,
                                        .symbols = &site->symbols};
        PM_TRY(visit(context, &features));
    }
    return PM_OK;
}
