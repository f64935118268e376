// E and S as sums of terms.
#include "model/potential.h"

#include <stdio.h>

typedef char term_prefix[96];

static const char *prefix_of(term_prefix buffer, const char *prefix, int term) {
    snprintf(buffer, sizeof(term_prefix), "%s.%d", prefix, term);
    return buffer;
}

bool pm_potential_exists(const pm_potential_spec *spec) {
    return spec->ngiven > 0 || spec->nterm > 0;
}

pm_status pm_potential_declare(const pm_potential_spec *spec, const pm_symbols *symbols,
                               pm_params *params, const char *prefix) {
    int size = 0;
    PM_TRY(pm_spec_locate(spec->at, pm_features_size(spec->ngiven, spec->given, symbols, &size)));
    for (int i = 0; i < spec->nterm; ++i) {
        term_prefix term;
        PM_TRY(pm_network_declare(&spec->term[i], symbols, 1, NULL, params,
                                  prefix_of(term, prefix, i)));
    }
    return PM_OK;
}

pm_node pm_potential_build(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *symbols,
                           const pm_params *params, const char *prefix) {
    pm_node sum = PM_NO_NODE;
    for (int i = 0; i < spec->ngiven; ++i) {
        const double coefficient = spec->given_coefficient == NULL ? 1 : spec->given_coefficient[i];
        const pm_node group = pm_feature_build(g, spec->given[i], symbols);
        const pm_node term = pm_sum_to(g, group, (pm_shape){true, 1, 1});
        sum = pm_add_or(g, sum, pm_scale(g, term, coefficient));
    }
    for (int i = 0; i < spec->nterm; ++i) {
        term_prefix term;
        sum = pm_add_or(
            g, sum,
            pm_network_build(g, &spec->term[i], symbols, 1, params, prefix_of(term, prefix, i)));
    }
    return sum;
}

bool pm_potential_is_discrete(const pm_potential_spec *spec) {
    for (int i = 0; i < spec->nterm; ++i) {
        if (!pm_features_are_discrete(spec->term[i].nfeature, spec->term[i].feature)) {
            return false;
        }
    }
    return true;
}

// The known linear form: its coefficients.
static void discrete_given(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *symbols,
                           pm_node *covector) {
    for (int i = 0; i < spec->ngiven; ++i) {
        int size = 1;
        pm_feature_size(spec->given[i], symbols, &size);
        const double coefficient = spec->given_coefficient == NULL ? 1 : spec->given_coefficient[i];
        const pm_node weight = pm_constant(g, coefficient, 1, size);
        pm_features_discrete(g, 1, &spec->given[i], symbols, symbols, weight, covector);
    }
}

void pm_potential_discrete(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *from,
                           const pm_symbols *to, const pm_params *params, const char *prefix,
                           pm_node *covector) {
    discrete_given(g, spec, from, covector);
    for (int i = 0; i < spec->nterm; ++i) {
        const pm_network_spec *network = &spec->term[i];
        if (network->nfeature == 0) {
            continue; // a constant
        }
        term_prefix term;
        const pm_node before = pm_features_build(g, network->nfeature, network->feature, from);
        const pm_node after = pm_features_build(g, network->nfeature, network->feature, to);
        const pm_node mean = pm_scale(g, pm_add(g, before, after), 0.5);
        const pm_node value =
            pm_network_build_from(g, network, mean, 1, params, prefix_of(term, prefix, i));
        pm_node weight;
        pm_gradient(g, value, PM_NO_NODE, 1, &mean, &weight);
        if (weight != PM_NO_NODE) {
            pm_features_discrete(g, network->nfeature, network->feature, from, to, weight,
                                 covector);
        }
    }
}

pm_status pm_potential_visit(const pm_potential_spec *spec, const pm_symbols *symbols,
                             const char *prefix, pm_normaliser_visit *visit, void *context) {
    for (int i = 0; i < spec->nterm; ++i) {
        term_prefix term;
        if (spec->term[i].nfeature > 0) {
            const pm_normaliser n = {PM_NORMALISE_FEATURES, prefix_of(term, prefix, i),
                                     spec->term[i].nfeature, spec->term[i].feature, symbols};
            PM_TRY(visit(context, &n));
        }
    }
    return PM_OK;
}
