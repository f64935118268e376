// Inertias and heat capacities.
#include "model/convex.h"

#include <math.h>
#include <stdio.h>

// Terms of a heat capacity beyond the constant one start with this share of it.
#define TERM_START 0.03

typedef char convex_name[160];

static const char *join(convex_name buffer, const char *prefix, const char *name) {
    snprintf(buffer, sizeof(convex_name), "%.120s.%s", prefix, name);
    return buffer;
}

// Writes the prefix of the parameters of term number i.
static void write_prefix(convex_name buffer, const pm_convex_spec *spec, const char *potential,
                         int i) {
    const char *kind = spec->kind == PM_CONVEX_INERTIA ? "inertia" : "capacity";
    snprintf(buffer, sizeof(convex_name), "%.40s.%s.%d", potential, kind, i);
}

// Returns the number of entries of A that are learned, where n components share an inertia. A known
// first one is not.
static int entries_of(const pm_convex_spec *spec, int n) {
    return n * (n + 1) / 2 - (spec->first > 0 ? 1 : 0);
}

pm_status pm_convex_declare(const pm_convex_spec *spec, int i, const pm_symbols *symbols,
                            pm_params *params, const char *potential) {
    convex_name prefix, name;
    write_prefix(prefix, spec, potential, i);
    int n = 0;
    PM_TRY(pm_spec_locate(spec->at, pm_features_size(spec->ngroup, spec->group, symbols, &n)));
    if (spec->kind == PM_CONVEX_CAPACITY) {
        PM_TRY(pm_params_add(params, join(name, prefix, "mean"), 1, n, false, 0,
                             PM_DEFAULT_TEMPERATURE));
        PM_TRY(pm_params_add(params, join(name, prefix, "deviation"), 1, n, false, 0, 1));
        PM_TRY(spec->first > 0
                   ? PM_OK
                   : pm_params_add(params, join(name, prefix, "first"), 1, n, true, 0, 0));
        return spec->nterm == 1 ? PM_OK
                                : pm_params_add(params, join(name, prefix, "shape"),
                                                spec->nterm - 1, n, true, 0, log(TERM_START));
    }
    if (n > PM_MAX_INERTIA || entries_of(spec, n) == 0) {
        return pm_spec_locate(
            spec->at, pm_fail(PM_ECONFIG, "an inertia of %d component%s, expected %d to %d", n,
                              n == 1 ? "" : "s", spec->first > 0 ? 2 : 1, PM_MAX_INERTIA));
    }
    PM_TRY(pm_params_add(params, join(name, prefix, "along"), 1, spec->ngroup, false, 0, 1));
    PM_TRY(pm_network_declare(&spec->network, symbols, entries_of(spec, n), NULL, params, prefix));
    // The inertia starts diagonal, and the same in all states.
    pm_param_entry *output = pm_params_find(params, join(name, prefix, "output.weight"));
    if (output != NULL) {
        output->spread = 0;
    }
    return PM_OK;
}

static pm_node build_inertia(pm_graph *g, const pm_convex_spec *spec, const pm_symbols *symbols,
                             const pm_params *params, const char *prefix) {
    pm_node y[PM_MAX_INERTIA];
    int n = 0;
    const pm_node along = pm_network_param(g, params, prefix, "along");
    for (int k = 0; k < spec->ngroup; ++k) {
        const pm_node group = pm_feature_build(g, spec->group[k], symbols);
        const int size = pm_graph_shape(g, group).cols;
        for (int c = 0; c < size; ++c) {
            y[n++] = pm_div(g, pm_slice(g, group, c, 1), pm_slice(g, along, k, 1));
        }
    }
    const pm_node entry =
        pm_network_build(g, &spec->network, symbols, entries_of(spec, n), params, prefix);
    pm_node sum = PM_NO_NODE;
    for (int col = 0; col < n; ++col) {
        pm_node flow = PM_NO_NODE; // component `col` of A^T D y
        for (int row = col; row < n; ++row) {
            const int at = row * (row + 1) / 2 + col - (spec->first > 0 ? 1 : 0);
            pm_node a = at < 0 ? pm_scale(g, pm_slice(g, along, 0, 1), sqrt(spec->first))
                               : pm_slice(g, entry, at, 1);
            a = at >= 0 && row == col ? pm_exp(g, a) : a;
            flow = pm_add_or(g, flow, pm_mul(g, a, y[row]));
        }
        sum = pm_add_or(g, sum, pm_square(g, flow));
    }
    return pm_scale(g, sum, 0.5);
}

static pm_node build_capacity(pm_graph *g, const pm_convex_spec *spec, const pm_symbols *symbols,
                              const pm_params *params, const char *prefix) {
    const pm_node T = pm_feature_build(g, spec->group[0], symbols);
    const pm_node mean = pm_network_param(g, params, prefix, "mean"); // T0
    const pm_node r = pm_div(g, T, mean), more = pm_offset(g, r, 1);
    // C of each term, divided by T0: the second derivative by r is f_k/r.
    const pm_node term[PM_MAX_TERMS] = {
        pm_mul(g, r, pm_offset(g, pm_log(g, r), -1)),
        pm_scale(g, pm_square(g, r), 1.0 / 2),
        pm_scale(g, pm_mul(g, more, pm_offset(g, pm_log(g, more), -1)), 2),
        pm_div(g, pm_constant(g, 1.0 / 2, 1, 1), r),
        pm_scale(g, pm_mul(g, r, pm_square(g, r)), 1.0 / 6),
    };
    pm_node sum = term[0], weights = pm_constant(g, 1, 1, 1);
    for (int k = 1; k < spec->nterm; ++k) {
        const int row = k - 1;
        const pm_node shape = pm_network_param(g, params, prefix, "shape");
        const pm_node weight = pm_exp(g, pm_gather_rows(g, shape, 1, &row));
        sum = pm_add(g, sum, pm_mul(g, weight, term[k]));
        weights = pm_add(g, weights, weight);
    }
    const pm_node first = spec->first > 0 ? pm_constant(g, spec->first, 1, 1)
                                          : pm_exp(g, pm_network_param(g, params, prefix, "first"));
    const pm_node scale = pm_mul(g, first, pm_div(g, mean, weights));
    return pm_sum_to(g, pm_mul(g, scale, sum), (pm_shape){true, 1, 1});
}

pm_node pm_convex_build(pm_graph *g, const pm_convex_spec *spec, int i, const pm_symbols *symbols,
                        const pm_params *params, const char *potential) {
    convex_name prefix;
    write_prefix(prefix, spec, potential, i);
    return spec->kind == PM_CONVEX_INERTIA ? build_inertia(g, spec, symbols, params, prefix)
                                           : build_capacity(g, spec, symbols, params, prefix);
}

pm_status pm_convex_visit(const pm_convex_spec *spec, int i, const pm_symbols *symbols,
                          const char *potential, pm_normaliser_visit *visit, void *context) {
    convex_name prefix;
    write_prefix(prefix, spec, potential, i);
    const bool inertia = spec->kind == PM_CONVEX_INERTIA;
    const pm_normaliser own = {.kind = inertia ? PM_NORMALISE_ALONG : PM_NORMALISE_FEATURES,
                               .prefix = prefix,
                               .count = spec->ngroup,
                               .expression = spec->group,
                               .symbols = symbols};
    PM_TRY(visit(context, &own));
    return inertia ? pm_network_visit(&spec->network, symbols, prefix, visit, context) : PM_OK;
}
