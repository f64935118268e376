// Builds thermal energies: exponentials of rising linear forms of the entropies, whose coefficients
// a network of the other features gives.
#include "model/thermal.h"

#include <math.h>
#include <stdio.h>

// Initial exponents of normalised entropies: in most data temperatures vary by some per cent. Each
// further exponential starts three times as steep.
#define FIRST_EXPONENT 0.05
#define NEXT_EXPONENT 3.0
#define EXPONENT_SPREAD 0.3
// The smallest exponent. With a smaller one the temperature would be constant over the data, and
// (exp(b s) - 1)/b would lose its digits.
#define SMALLEST_EXPONENT 1e-5
// The square root of k with which training starts, and the smallest k: below, ln(1 + k exp(u))/k
// would lose its digits.
#define FIRST_BEND 0.3
#define SMALLEST_BEND 1e-4

typedef char thermal_name[160];

static const char *join(thermal_name buffer, const char *prefix, const char *name) {
    snprintf(buffer, sizeof(thermal_name), "%s.%s", prefix, name);
    return buffer;
}

// Returns the spec of the network of the other features, which is a constant if there are none.
static pm_network_spec body_of(const pm_network_spec *spec) {
    pm_network_spec body = *spec;
    body.nfeature = spec->nfeature - spec->nthermal;
    body.nthermal = 0;
    return body;
}

// Returns the number of rows of exponentials for n entropies. The shares in a row have the sum 1.
static int rows_of(const pm_network_spec *spec, int n) {
    return spec->separate ? n : 1;
}

pm_status pm_thermal_declare(const pm_network_spec *spec, const pm_symbols *symbols,
                             pm_params *params, const char *prefix) {
    const pm_network_spec body = body_of(spec);
    thermal_name name;
    int n = 0;
    PM_TRY(pm_spec_locate(
        spec->at, pm_features_size(spec->nthermal, spec->feature + body.nfeature, symbols, &n)));
    PM_TRY(pm_params_add(params, join(name, prefix, "mean"), 1, n, false, 0, 0));
    PM_TRY(pm_params_add(params, join(name, prefix, "deviation"), 1, n, false, 0, 1));
    PM_TRY(pm_params_add(params, join(name, prefix, "unit"), 1, 1, false, 0, 1));
    const int rows = rows_of(spec, n);
    if (spec->exponentials > 1) {
        PM_TRY(pm_params_add(params, join(name, prefix, "amplitude"), rows, spec->exponentials,
                             true, 0, 0));
    }
    PM_TRY(pm_params_add_shared(params, PM_WARMTH, 0));
    PM_TRY(pm_network_declare(&body, symbols, 1 + rows * spec->exponentials, NULL, params,
                              join(name, prefix, "body")));
    PM_TRY(pm_params_add(params, join(name, prefix, "exponent"), n, spec->exponentials, true,
                         EXPONENT_SPREAD, log(FIRST_EXPONENT)));
    if (spec->rising) {
        thermal_name bend;
        PM_TRY(pm_params_add(params, join(bend, prefix, "bend"), rows, spec->exponentials, true, 0,
                             FIRST_BEND));
    }
    double *exponent = pm_params_find(params, name)->value;
    for (int i = 0; i < n * spec->exponentials; ++i) {
        exponent[i] = log(FIRST_EXPONENT) + i % spec->exponentials * log(NEXT_EXPONENT);
    }
    return PM_OK;
}

pm_node pm_thermal_deviation(pm_graph *g, const pm_network_spec *spec, const pm_params *params,
                             const char *prefix) {
    const pm_node own = pm_network_param(g, params, prefix, "deviation");
    thermal_name name;
    if (spec->nfeature == spec->nthermal) {
        return own;
    }
    const pm_node part[2] = {pm_network_param(g, params, join(name, prefix, "body"), "deviation"),
                             own};
    return pm_concat(g, 2, part);
}

// The forms [rows][count] of the exponentials before h is added, and beta and B of them.
typedef struct rises {
    pm_node form, beta, height;
} rises;

// Returns the forms of the normalised entropies s [1][n] with the exponents b [n][count]. The order
// in which nodes are made decides the order of sums in gradients.
static rises build_rises(pm_graph *g, const pm_network_spec *spec, pm_node s, pm_node b,
                         pm_node deviation) {
    const int n = pm_graph_shape(g, b).rows;
    rises r;
    if (spec->separate) {
        r.beta = b;
        r.form = pm_mul(g, pm_reshape(g, s, n, 1), b);
        r.height = pm_div(g, b, pm_reshape(g, deviation, n, 1));
    } else {
        const pm_node mean = pm_constant(g, 1.0 / n, 1, n);
        r.beta = pm_matmul(g, mean, false, b, false);
        r.form = pm_matmul(g, s, false, b, false);
        r.height = pm_matmul(g, pm_div(g, mean, deviation), false, b, false);
    }
    return r;
}

pm_node pm_thermal_build_from(pm_graph *g, const pm_network_spec *spec, pm_node features,
                              const pm_params *params, const char *prefix) {
    const pm_network_spec body = body_of(spec);
    const int count = spec->exponentials;
    thermal_name name;
    join(name, prefix, "body");
    const pm_node warmth = pm_warmth(g, params);
    const pm_node deviation = pm_network_param(g, params, prefix, "deviation");
    const int n = pm_graph_shape(g, deviation).cols, rows = rows_of(spec, n);
    // The logarithms of the shares of the exponentials in the temperature at s = mean, h = 0.
    pm_node share;
    if (count == 1) {
        share = pm_constant(g, 0, rows, 1);
    } else {
        const pm_node amplitude = pm_network_param(g, params, prefix, "amplitude");
        const pm_node one = pm_constant(g, 1, rows, count);
        const pm_node sum = pm_dot(g, pm_exp(g, amplitude), one);
        share = pm_sub(g, amplitude, pm_log(g, sum));
    }
    const pm_node size = pm_add(g, share, warmth); // ln A w [rows][count]
    const pm_node rise = pm_sub(g, pm_network_param(g, params, prefix, "exponent"), warmth);
    const pm_node exponent = pm_offset(g, pm_exp(g, rise), SMALLEST_EXPONENT); // b [n][count]
    const int nx = pm_graph_shape(g, features).cols - n;
    const pm_node out = body.nfeature == 0
                            ? pm_network_param(g, params, name, "constant")
                            : pm_network_build_from(g, &body, pm_slice(g, features, 0, nx),
                                                    1 + rows * count, params, name);
    const pm_node s = pm_div(
        g, pm_sub(g, pm_slice(g, features, nx, n), pm_network_param(g, params, prefix, "mean")),
        deviation);
    const rises r = build_rises(g, spec, s, exponent, deviation);
    const pm_node h = pm_reshape(g, pm_slice(g, out, 1, rows * count), rows, count);
    const pm_node shift = pm_mul(g, h, r.beta);
    // The quadratic part of the heat at s = mean. It is taken away, since the network f describes
    // it (thermal.h).
    const pm_node half = pm_scale(g, pm_square(g, shift), 0.5);
    pm_node stored;
    if (spec->rising) {
        const pm_node root = pm_network_param(g, params, prefix, "bend");
        const pm_node k = pm_offset(g, pm_square(g, root), SMALLEST_BEND);
        const pm_node sum = pm_offset(g, k, 1), form = pm_exp(g, pm_add(g, r.form, shift));
        const pm_node bent = pm_log(g, pm_offset(g, pm_mul(g, k, form), 1));
        const pm_node risen = pm_mul(g, pm_div(g, sum, k), pm_sub(g, bent, pm_log(g, sum)));
        stored = pm_sub(g, risen, pm_add(g, shift, pm_div(g, half, sum)));
    } else {
        const pm_node own = pm_add(g, shift, half);
        stored = pm_sub(g, pm_offset(g, pm_exp(g, pm_add(g, r.form, shift)), -1), own);
    }
    const pm_node heats = pm_dot(g, pm_div(g, pm_exp(g, size), r.height), stored);
    const pm_node heat =
        pm_scale(g, pm_sum_to(g, heats, (pm_shape){true, 1, 1}), spec->temperature);
    return pm_add(g, heat,
                  pm_mul(g, pm_slice(g, out, 0, 1), pm_network_param(g, params, prefix, "unit")));
}

pm_status pm_thermal_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context) {
    const int nx = spec->nfeature - spec->nthermal;
    const char *const *entropy = spec->feature + nx;
    thermal_name name;
    const pm_normaliser own = {.kind = PM_NORMALISE_FEATURES,
                               .prefix = prefix,
                               .count = spec->nthermal,
                               .expression = entropy,
                               .symbols = symbols};
    const pm_network_spec body = body_of(spec);
    const pm_normaliser unit = {.kind = PM_NORMALISE_UNIT,
                                .prefix = prefix,
                                .count = spec->nthermal,
                                .expression = entropy,
                                .symbols = symbols};
    PM_TRY(visit(context, &own));
    PM_TRY(pm_network_visit(&body, symbols, join(name, prefix, "body"), visit, context));
    return visit(context, &unit);
}
