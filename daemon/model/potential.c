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
