// Sums of formulas, linear forms and networks, and their discrete derivatives.
#include "model/potential.h"

#include <stdio.h>
#include <string.h>

#include "model/convex.h"
#include "model/site.h"
#include "model/thermal.h"

// The square of the smallest change of normalised features for which a discrete slope is corrected.
#define SMALLEST_CHANGE 1e-12

typedef char term_prefix[96];

static const char *prefix_of(term_prefix buffer, const char *prefix, int term) {
    snprintf(buffer, sizeof(term_prefix), "%s.%d", prefix, term);
    return buffer;
}

// Returns the output of a network times the parameter "<prefix>.unit", where the network has one.
static pm_node scale_term(pm_graph *g, const pm_network_spec *term, const pm_params *params,
                          const char *prefix, pm_node out) {
    return term->scaled ? pm_mul(g, out, pm_network_param(g, params, prefix, "unit")) : out;
}

// Returns the value of a term [1][1] from the values of its features.
static pm_node build_from(pm_graph *g, const pm_network_spec *term, pm_node features,
                          const pm_params *params, const char *prefix) {
    return term->nthermal > 0
               ? pm_thermal_build_from(g, term, features, params, prefix)
               : scale_term(g, term, params, prefix,
                            pm_network_build_from(g, term, features, 1, params, prefix));
}

bool pm_potential_exists(const pm_potential_spec *spec) {
    return spec->nformula > 0 || spec->ngiven > 0 || spec->nterm > 0 || spec->nconvex > 0;
}

bool pm_potential_mentions(const pm_potential_spec *spec, const char *name) {
    bool mentions = false;
    for (int i = 0; i < spec->nformula; ++i) {
        mentions = mentions || pm_formula_mentions(&spec->formula[i], name);
    }
    for (int i = 0; i < spec->ngiven; ++i) {
        mentions = mentions || strcmp(spec->given[i], name) == 0;
    }
    for (int i = 0; i < spec->nterm; ++i) {
        for (int k = 0; k < spec->term[i].nfeature; ++k) {
            mentions = mentions || pm_feature_mentions(spec->term[i].feature[k], name);
        }
    }
    for (int i = 0; i < spec->nconvex; ++i) {
        const pm_convex_spec *convex = &spec->convex[i];
        mentions = mentions || pm_is_listed(convex->ngroup, convex->group, name);
        for (int k = 0; k < convex->network.nfeature; ++k) {
            mentions = mentions || pm_feature_mentions(convex->network.feature[k], name);
        }
    }
    return mentions;
}

pm_status pm_potential_declare(const pm_potential_spec *spec, const pm_symbols *symbols,
                               pm_params *params, const char *prefix) {
    int size = 0;
    PM_TRY(pm_spec_locate(spec->at, pm_features_size(spec->ngiven, spec->given, symbols, &size)));
    for (int i = 0; i < spec->nformula; ++i) {
        PM_TRY(pm_formula_check(&spec->formula[i], symbols));
    }
    for (int i = 0; i < spec->nterm; ++i) {
        term_prefix term;
        if (spec->term[i].nthermal == 0 &&
            (spec->term[i].exponentials > 0 || spec->term[i].temperature > 0 ||
             spec->term[i].separate || spec->term[i].rising)) {
            return pm_spec_locate(spec->term[i].at,
                                  pm_fail(PM_ECONFIG, "only the energy of an entropy variable has "
                                                      "a temperature and exponentials"));
        }
        prefix_of(term, prefix, i);
        PM_TRY(spec->term[i].nthermal > 0
                   ? pm_thermal_declare(&spec->term[i], symbols, params, term)
                   : pm_network_declare(&spec->term[i], symbols, 1, NULL, params, term));
        char unit[sizeof term + 8];
        snprintf(unit, sizeof unit, "%s.unit", term);
        PM_TRY(spec->term[i].scaled ? pm_params_add(params, unit, 1, 1, false, 0, 1) : PM_OK);
    }
    for (int i = 0; i < spec->nconvex; ++i) {
        PM_TRY(pm_convex_declare(&spec->convex[i], i, symbols, params, prefix));
    }
    return PM_OK;
}

pm_node pm_potential_build(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *symbols,
                           const pm_params *params, const char *prefix) {
    pm_node sum = PM_NO_NODE;
    for (int i = 0; i < spec->nformula; ++i) {
        sum = pm_add_or(g, sum, pm_formula_build(g, &spec->formula[i], symbols));
    }
    for (int i = 0; i < spec->ngiven; ++i) {
        const double coefficient = spec->given_coefficient == NULL ? 1 : spec->given_coefficient[i];
        const pm_node group = pm_feature_build(g, spec->given[i], symbols);
        const pm_node term = pm_sum_to(g, group, (pm_shape){true, 1, 1});
        sum = pm_add_or(g, sum, pm_scale(g, term, coefficient));
    }
    for (int i = 0; i < spec->nterm; ++i) {
        const pm_network_spec *network = &spec->term[i];
        term_prefix term;
        prefix_of(term, prefix, i);
        pm_node value;
        if (network->nfeature > 0) {
            const pm_node features =
                pm_features_build(g, network->nfeature, network->feature, symbols);
            value = build_from(g, network, features, params, term);
        } else {
            value = pm_network_build(g, network, symbols, 1, params, term);
            value = scale_term(g, network, params, term, value);
        }
        sum = pm_add_or(g, sum, value);
    }
    for (int i = 0; i < spec->nconvex; ++i) {
        sum = pm_add_or(g, sum, pm_convex_build(g, &spec->convex[i], i, symbols, params, prefix));
    }
    return sum;
}

bool pm_potential_is_discrete(const pm_potential_spec *spec) {
    bool all = pm_features_are_discrete(spec->ngiven, spec->given);
    for (int i = 0; i < spec->nterm; ++i) {
        all = all && pm_features_are_discrete(spec->term[i].nfeature, spec->term[i].feature);
    }
    return all;
}

// Returns the slope of a network between two values of its features: the derivative at their mean,
// corrected along the change so that slope . change is the change of the output (Gonzalez 1996).
// The correction vanishes where the change is as small as rounding.
static pm_node discrete_slope(pm_graph *g, const pm_network_spec *network, pm_node before,
                              pm_node after, const pm_params *params, const char *prefix) {
    const pm_node mean = pm_scale(g, pm_add(g, before, after), 0.5);
    const pm_node at_mean = build_from(g, network, mean, params, prefix);
    pm_node slope;
    pm_gradient(g, at_mean, PM_NO_NODE, 1, &mean, &slope);
    const bool linear =
        network->nhidden == 0 && network->nthermal == 0 && network->skip < PM_SKIP_QUADRATIC;
    if (slope == PM_NO_NODE || linear) {
        return slope;
    }
    const pm_node scale = network->nthermal > 0 ? pm_thermal_deviation(g, network, params, prefix)
                                                : pm_network_param(g, params, prefix, "deviation");
    const pm_node change = pm_sub(g, after, before);
    const pm_node scaled = pm_div(g, change, scale);
    const pm_node rise = pm_sub(g, build_from(g, network, after, params, prefix),
                                build_from(g, network, before, params, prefix));
    const pm_node missing = pm_sub(g, rise, pm_dot(g, slope, change));
    const pm_node square = pm_offset(g, pm_dot(g, scaled, scaled), SMALLEST_CHANGE);
    return pm_add(g, slope, pm_mul(g, pm_div(g, missing, square), pm_div(g, scaled, scale)));
}

void pm_potential_discrete(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *from,
                           const pm_symbols *to, const pm_params *params, const char *prefix,
                           pm_node *covector) {
    for (int i = 0; i < spec->nformula; ++i) {
        pm_formula_discrete(g, &spec->formula[i], from, to, covector);
    }
    for (int i = 0; i < spec->ngiven; ++i) { // the coefficients are the discrete derivative
        int size = 1;
        pm_feature_size(spec->given[i], from, &size);
        const double coefficient = spec->given_coefficient == NULL ? 1 : spec->given_coefficient[i];
        const pm_node weight = pm_constant(g, coefficient, 1, size);
        pm_features_discrete(g, 1, &spec->given[i], from, to, weight, covector);
    }
    for (int i = 0; i < spec->nterm; ++i) {
        const pm_network_spec *network = &spec->term[i];
        if (network->nfeature == 0) {
            continue; // a constant
        }
        term_prefix term;
        const pm_node before = pm_features_build(g, network->nfeature, network->feature, from);
        const pm_node after = pm_features_build(g, network->nfeature, network->feature, to);
        const pm_node slope =
            discrete_slope(g, network, before, after, params, prefix_of(term, prefix, i));
        if (slope != PM_NO_NODE) {
            pm_features_discrete(g, network->nfeature, network->feature, from, to, slope, covector);
        }
    }
}

pm_status pm_potential_visit(const pm_potential_spec *spec, const pm_symbols *symbols,
                             const char *prefix, pm_normaliser_visit *visit, void *context) {
    for (int i = 0; i < spec->nterm; ++i) {
        term_prefix term;
        if (spec->term[i].nthermal > 0) {
            PM_TRY(pm_thermal_visit(&spec->term[i], symbols, prefix_of(term, prefix, i), visit,
                                    context));
        } else {
            PM_TRY(pm_network_visit(&spec->term[i], symbols, prefix_of(term, prefix, i), visit,
                                    context));
        }
        if (spec->term[i].scaled && spec->term[i].nthermal == 0) {
            const pm_normaliser unit = {.kind = PM_NORMALISE_UNIT,
                                        .prefix = prefix_of(term, prefix, i),
                                        .symbols = symbols};
            PM_TRY(visit(context, &unit));
        }
    }
    for (int i = 0; i < spec->nconvex; ++i) {
        PM_TRY(pm_convex_visit(&spec->convex[i], i, symbols, prefix, visit, context));
    }
    return PM_OK;
}
