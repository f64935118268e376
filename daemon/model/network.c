// Declares and builds multi-layer networks.
#include "model/network.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

// Standard deviations of the initial values. Random biases spread the units of the hidden layers
// over the data. Beside a skip the output weights start at zero, so that training first fits the
// skip; second-order training is slow if hidden layers contribute from the start. Beside a quartic
// skip of an energy they even wait until the initial weights have been chosen. What the polynomial
// can represent is then left to it, and it continues beyond the data where hidden units saturate:
// on a spring of the force k x + c x^3, rollouts that start 5 % beyond the training data were off
// by 0.04 instead of 17 %.
#define BIAS_SPREAD 0.5
#define SKIP_SPREAD 0.01
// The standard deviation of the output weights without a skip. They do not start at zero, since a
// constant potential drives nothing.
#define OUTPUT_SPREAD 0.3
// Half the initial curvature of an energy, in its unit and in normalised features: most energies
// have a minimum.
#define CURVATURE_START 0.5

#define MAX_SQUARED 4096 // features whose products a quadratic skip may form

typedef char parameter_name[160];

static const char *join(parameter_name buffer, const char *prefix, const char *name) {
    snprintf(buffer, sizeof(parameter_name), "%s.%s", prefix, name);
    return buffer;
}

// --- declaration ---

typedef struct declaration {
    pm_params *params;
    const char *prefix;
    bool late; // whether the hidden layers stay as they start while initial weights are compared
} declaration;

static pm_status declare(const declaration *d, const char *name, int rows, int cols, bool trained,
                         double spread, const double *start) {
    parameter_name full;
    join(full, d->prefix, name);
    PM_TRY(pm_params_add(d->params, full, rows, cols, trained, spread, 0));
    if (start != NULL) {
        memcpy(pm_params_find(d->params, full)->value, start,
               (size_t)rows * (size_t)cols * sizeof *start);
    }
    return PM_OK;
}

static pm_status declare_hidden(const declaration *d, const char *name, int rows, int cols,
                                double spread) {
    parameter_name full;
    PM_TRY(declare(d, name, rows, cols, true, spread, NULL));
    pm_params_find(d->params, join(full, d->prefix, name))->late =
        d->late ? PM_LATE_LAYERS : PM_AT_ONCE;
    return PM_OK;
}

// Marks an entry that has been declared.
static pm_status let_shrink(const declaration *d, const char *name, pm_status declared) {
    parameter_name full;
    pm_param_entry *entry = pm_params_find(d->params, join(full, d->prefix, name));
    if (entry != NULL) {
        entry->shrinks = true;
    }
    return declared;
}

// Declares the hidden layers, with one network output for each of `nout`.
static pm_status declare_layers(const declaration *d, const pm_network_spec *spec, int nfeature,
                                int nout) {
    int width = nfeature;
    for (int i = 0; i < spec->nhidden; ++i) {
        char name[64];
        snprintf(name, sizeof name, "layer%d.weight", i);
        PM_TRY(
            let_shrink(d, name, declare_hidden(d, name, width, spec->hidden[i], 1 / sqrt(width))));
        snprintf(name, sizeof name, "layer%d.bias", i);
        PM_TRY(declare_hidden(d, name, 1, spec->hidden[i], BIAS_SPREAD));
        width = spec->hidden[i];
    }
    const double spread = spec->skip == PM_SKIP_NONE ? OUTPUT_SPREAD / sqrt(width) : 0;
    return spec->nhidden > 0 ? let_shrink(d, "output.weight",
                                          declare_hidden(d, "output.weight", width, nout, spread))
                             : PM_OK;
}

// Declares the skip. That of an energy with a quadratic term starts convex.
static pm_status declare_skip(const declaration *d, const pm_network_spec *spec, int nfeature,
                              int nout, double spread) {
    parameter_name full;
    if (spec->skip != PM_SKIP_NONE) {
        PM_TRY(declare(d, "linear", nfeature, nout, true, spread, NULL));
    }
    if (spec->skip >= PM_SKIP_QUADRATIC) {
        PM_TRY(declare(d, "quadratic", nfeature * nfeature, nout, true, spread, NULL));
        // The first output of an energy starts with a positive curvature, so that it has a minimum.
        pm_param_entry *quadratic = pm_params_find(d->params, join(full, d->prefix, "quadratic"));
        for (int i = 0; i < nfeature && spec->scaled; ++i) {
            quadratic->value[(ptrdiff_t)(i * nfeature + i) * quadratic->cols] = CURVATURE_START;
        }
    }
    if (spec->skip == PM_SKIP_QUARTIC) {
        PM_TRY(declare(d, "cubic", nfeature, nout, true, 0, NULL));
        PM_TRY(declare(d, "quartic", nfeature, nout, true, 0, NULL));
    }
    return PM_OK;
}

pm_status pm_network_declare(const pm_network_spec *spec, const pm_symbols *symbols, int nout,
                             const double *start, pm_params *params, const char *prefix) {
    const bool late = spec->scaled && spec->skip == PM_SKIP_QUARTIC;
    const declaration d = {params, prefix, late};
    const double spread = spec->spread > 0 ? spec->spread : SKIP_SPREAD;
    parameter_name full;
    if (spec->nfeature == 0) {
        return declare(&d, "constant", 1, nout, true, spread, start);
    }
    int nfeature = 0;
    PM_TRY(pm_spec_locate(spec->at,
                          pm_features_size(spec->nfeature, spec->feature, symbols, &nfeature)));
    if (spec->skip >= PM_SKIP_QUADRATIC && nfeature > MAX_SQUARED) {
        return pm_spec_locate(spec->at,
                              pm_fail(PM_ECONFIG, "%s: %d features, at most %d can be squared",
                                      prefix, nfeature, MAX_SQUARED));
    }
    PM_TRY(declare(&d, "mean", 1, nfeature, false, 0, NULL));
    PM_TRY(pm_params_add(params, join(full, prefix, "deviation"), 1, nfeature, false, 0, 1));
    PM_TRY(declare_layers(&d, spec, nfeature, nout));
    PM_TRY(declare(&d, "output.bias", 1, nout, true, spec->scaled ? 0 : spec->spread, start));
    return declare_skip(&d, spec, nfeature, nout, spread);
}

// --- building ---

pm_node pm_network_param(pm_graph *g, const pm_params *params, const char *prefix,
                         const char *name) {
    parameter_name full;
    const pm_param_entry *entry = pm_params_find(params, join(full, prefix, name));
    assert(entry != NULL);
    return entry->trained || entry->shared ? pm_weight(g, entry->value, entry->rows, entry->cols)
                                           : pm_param(g, entry->value, entry->rows, entry->cols);
}

pm_node pm_warmth(pm_graph *g, const pm_params *params) {
    return pm_weight(g, pm_params_find(params, PM_WARMTH)->value, 1, 1);
}

pm_node pm_network_build(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                         int nout, const pm_params *params, const char *prefix) {
    if (spec->nfeature == 0) {
        return pm_network_param(g, params, prefix, "constant");
    }
    const pm_node features = pm_features_build(g, spec->nfeature, spec->feature, symbols);
    return pm_network_build_from(g, spec, features, nout, params, prefix);
}

static pm_node build_layers(pm_graph *g, const pm_network_spec *spec, pm_node features, int nout,
                            const pm_params *params, const char *prefix) {
    const pm_node x = pm_div(g, pm_sub(g, features, pm_network_param(g, params, prefix, "mean")),
                             pm_network_param(g, params, prefix, "deviation"));
    const int n = pm_graph_shape(g, x).cols;
    pm_node out = PM_NO_NODE;
    if (spec->nhidden > 0) {
        pm_node layer = x;
        for (int i = 0; i < spec->nhidden; ++i) {
            char name[64];
            snprintf(name, sizeof name, "layer%d.weight", i);
            layer = pm_matmul(g, layer, false, pm_network_param(g, params, prefix, name), false);
            snprintf(name, sizeof name, "layer%d.bias", i);
            layer = pm_add(g, layer, pm_network_param(g, params, prefix, name));
            layer = spec->activation == PM_TANH       ? pm_tanh(g, layer)
                    : spec->activation == PM_SOFTPLUS ? pm_softplus(g, layer)
                                                      : pm_silu(g, layer);
        }
        const pm_node weight = pm_network_param(g, params, prefix, "output.weight");
        out = pm_matmul(g, layer, false, weight, false);
    }
    if (spec->skip != PM_SKIP_NONE) {
        const pm_node weight = pm_network_param(g, params, prefix, "linear");
        out = pm_add_or(g, out, pm_matmul(g, x, false, weight, false));
    }
    if (spec->skip >= PM_SKIP_QUADRATIC) {
        const pm_node products = pm_reshape(g, pm_matmul(g, x, true, x, false), 1, n * n);
        const pm_node weight = pm_network_param(g, params, prefix, "quadratic");
        out = pm_add_or(g, out, pm_matmul(g, products, false, weight, false));
    }
    if (spec->skip == PM_SKIP_QUARTIC) {
        const pm_node square = pm_square(g, x);
        const pm_node cubic = pm_network_param(g, params, prefix, "cubic");
        const pm_node quartic = pm_network_param(g, params, prefix, "quartic");
        out = pm_add_or(g, out, pm_matmul(g, pm_mul(g, x, square), false, cubic, false));
        out = pm_add_or(g, out, pm_matmul(g, pm_square(g, square), false, quartic, false));
    }
    const pm_node bias = pm_network_param(g, params, prefix, "output.bias");
    // A network without hidden layers and without a skip is its bias.
    return out == PM_NO_NODE ? pm_broadcast_to(g, bias, (pm_shape){true, 1, nout})
                             : pm_add(g, out, bias);
}

pm_node pm_network_build_from(pm_graph *g, const pm_network_spec *spec, pm_node features, int nout,
                              const pm_params *params, const char *prefix) {
    assert(spec->nthermal == 0 && (!spec->zero_at_origin || nout == 1));
    if (!spec->zero_at_origin) {
        return build_layers(g, spec, features, nout, params, prefix);
    }
    // The output minus its tangent at features of 0.
    const pm_node zero = pm_constant(g, 0, 1, 1);
    const pm_node origin = pm_broadcast_to(g, zero, pm_graph_shape(g, features));
    const pm_node there = build_layers(g, spec, origin, 1, params, prefix);
    const pm_node out = build_layers(g, spec, features, 1, params, prefix);
    pm_node slope;
    pm_gradient(g, there, PM_NO_NODE, 1, &origin, &slope);
    const pm_node above = pm_sub(g, out, there);
    return slope == PM_NO_NODE ? above : pm_sub(g, above, pm_dot(g, slope, features));
}

pm_status pm_network_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context) {
    const pm_normaliser features = {.kind = PM_NORMALISE_FEATURES,
                                    .prefix = prefix,
                                    .count = spec->nfeature,
                                    .expression = spec->feature,
                                    .symbols = symbols};
    return spec->nfeature > 0 ? visit(context, &features) : PM_OK;
}
