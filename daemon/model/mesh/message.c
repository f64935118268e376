// Encode, process, decode. A network is described once, by what builds it: to declare its
// parameters it is built on a graph that is thrown away. They are drawn in order of declaration, so
// no call has two arguments that name any: C does not say which is evaluated first.
#include "model/mesh/message.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "graph/node.h"

// Spread of initial biases, and the gain of what reads differences between neighbours, which are
// small against the fields.
#define BIAS_SPREAD 0.5
#define DIFFERENCE_GAIN 3.0
// Sums over the six neighbours begin as large as what they are added to.
#define GATHER_GAIN 0.4
// Decoders begin small, so that training begins with what is given.
#define DECODE_GAIN 0.03
// Learned functions of the place that weigh the products of a driver with the first field.
#define LEVERS 6
// Of what a network passes on over all edges, of patterns, and of matrices of all nodes: far above
// any that can be trained, and memory that any host has. Sizes come from files.
#define MOST_NUMBERS 16777216

typedef char parameter_name[160];

// A network while it is described.
typedef struct net {
    pm_graph *g;
    const pm_network_spec *spec;
    const pm_mesh *mesh;
    int width;
    const char *prefix;
    const pm_params *params;
    pm_params *declaring; // where parameters that are new go; NULL: they are all there
    pm_status status;     // of declaring; after a failure nothing more is declared
    const pm_symbols *symbols;
    pm_node where;                  // [nnode][width] the learned features of a node's place
    pm_node field[PM_MAX_FEATURES]; // [nnode][components] of rms 1
    pm_node h;                      // [nnode][width] the hidden state
    pm_node hidden;                 // [1][..] functions of the amplitudes; PM_NO_NODE: no patterns
} net;

// --- parameters ---

typedef struct shape_of {
    int rows, cols;
    bool trained;
    double spread;
} shape_of;

static pm_node parameter(net *n, const char *name, shape_of s) {
    parameter_name full;
    snprintf(full, sizeof full, "%s.%s", n->prefix, name);
    if (n->declaring != NULL && n->status == PM_OK) {
        n->status = pm_params_add(n->declaring, full, s.rows, s.cols, s.trained, s.spread,
                                  s.trained ? 0 : 1);
    }
    if (n->status != PM_OK) {
        return pm_constant(n->g, 0, s.rows, s.cols);
    }
    const pm_param_entry *entry = pm_params_find(n->params, full);
    assert(entry != NULL &&
           (pm_graph_exhausted(n->g) || (entry->rows == s.rows && entry->cols == s.cols)));
    return s.trained ? pm_weight(n->g, entry->value, s.rows, s.cols)
                     : pm_param(n->g, entry->value, s.rows, s.cols);
}

// x times a matrix of weights, whose results begin `gain` times as large as x.
static pm_node linear(net *n, const char *name, pm_node x, int nout, double gain) {
    const int nin = pm_graph_shape(n->g, x).cols;
    const shape_of s = {nin, nout, true, gain / sqrt(nin)};
    return pm_matmul(n->g, x, false, parameter(n, name, s), false);
}

static pm_node add_bias(net *n, const char *name, pm_node x) {
    const shape_of s = {1, pm_graph_shape(n->g, x).cols, true, BIAS_SPREAD};
    return pm_add(n->g, x, parameter(n, name, s));
}

// Of the mesh: written when it is declared, read from a weights file later.
static pm_node mesh_features(net *n, const char *name, int rows, int cols,
                             void (*fill)(const pm_mesh *, double *)) {
    parameter_name full;
    snprintf(full, sizeof full, "%s.%s", n->prefix, name);
    const bool fresh = pm_params_find(n->params, full) == NULL;
    const pm_node node = parameter(n, name, (shape_of){rows, cols, false, 0});
    pm_param_entry *entry = pm_params_find(n->params, full);
    if (fresh && entry != NULL) {
        fill(n->mesh, entry->value);
    }
    return node;
}

// --- encode ---

// Of a group that has passed check_field.
static int size_of(const pm_symbols *symbols, const char *name) {
    int size = 0;
    (void)pm_feature_size(name, symbols, &size);
    return size;
}

// A group's value [1][size]; while parameters are declared, where values are not known, an input.
static pm_node value_of(net *n, const char *name) {
    if (n->declaring == NULL) {
        return pm_feature_build(n->g, name, n->symbols);
    }
    return pm_input(n->g, true, 1, size_of(n->symbols, name));
}

// The field as rows of nodes, divided by its typical component.
static pm_node scaled_field(net *n, int which, const char *name) {
    const int count = n->spec->nfeature + (n->spec->message->driver != NULL);
    const pm_node along = parameter(n, "along", (shape_of){1, count, false, 0});
    const pm_node x = value_of(n, name);
    const int size = pm_graph_shape(n->g, x).cols;
    const pm_node length = pm_slice(n->g, along, which, 1);
    const pm_node scaled = pm_div(n->g, pm_scale(n->g, x, sqrt(size)), length);
    return pm_reshape(n->g, scaled, n->mesh->nnode, size / n->mesh->nnode);
}

static void encode(net *n) {
    pm_graph *g = n->g;
    const pm_node position =
        mesh_features(n, "position", n->mesh->nnode, PM_MESH_NODE_FEATURES, pm_mesh_node_features);
    const pm_node near = pm_tanh(
        g, add_bias(n, "where0.bias", linear(n, "where0.weight", position, 2 * n->width, 2)));
    n->where =
        pm_tanh(g, add_bias(n, "where1.bias", linear(n, "where1.weight", near, n->width, 1)));
    for (int i = 0; i < n->spec->nfeature; ++i) {
        n->field[i] = scaled_field(n, i, n->spec->feature[i]);
    }
    const pm_node fields = pm_concat(g, n->spec->nfeature, n->field);
    const pm_node by_place = linear(n, "encode.where", n->where, n->width, 1);
    const pm_node by_field = linear(n, "encode.field", fields, n->width, 1);
    n->h = pm_tanh(g, add_bias(n, "encode.bias", pm_add(g, by_field, by_place)));
}

// --- process ---

static const char *join(parameter_name buffer, const char *stage, int pass, const char *name) {
    snprintf(buffer, sizeof(parameter_name), "%s%d.%s", stage, pass, name);
    return buffer;
}

// Rows of edges [nedge][cols]: `at_source` of the node each comes from, `at_target` of the node it
// leads to, and learned features of its direction.
static pm_node gather_edges(net *n, const char *stage, int pass, pm_node at_source,
                            pm_node at_target) {
    pm_graph *g = n->g;
    const pm_mesh *m = n->mesh;
    parameter_name name;
    const pm_node edge =
        mesh_features(n, "edge", PM_MESH_DIRECTIONS, PM_MESH_EDGE_FEATURES, pm_mesh_edge_features);
    const pm_node direction = linear(n, join(name, stage, pass, "edge"), edge, n->width, 2);
    const pm_node ends = pm_add(g, pm_gather_rows(g, at_source, m->nedge, m->source),
                                pm_gather_rows(g, at_target, m->nedge, m->target));
    return pm_add(g, ends, pm_gather_rows(g, direction, m->nedge, m->direction));
}

static pm_node scatter_edges(net *n, pm_node messages) {
    return pm_scatter_add_rows(n->g, messages, n->mesh->nnode, n->mesh->nedge, n->mesh->target);
}

static void process(net *n) {
    pm_graph *g = n->g;
    const int w = n->width;
    for (int p = 0; p < n->spec->message->passes; ++p) {
        parameter_name name;
        const pm_node difference =
            linear(n, join(name, "pass", p, "difference"), n->field[0], w, DIFFERENCE_GAIN);
        const pm_node at_source =
            pm_add(g, linear(n, join(name, "pass", p, "source"), n->h, w, 1), difference);
        const pm_node at_target =
            pm_sub(g, linear(n, join(name, "pass", p, "target"), n->h, w, 1), difference);
        const pm_node biased = add_bias(n, join(name, "pass", p, "bias"), at_target);
        const pm_node message = pm_tanh(g, gather_edges(n, "pass", p, at_source, biased));
        const pm_node sum = scatter_edges(n, message);
        pm_node change = linear(n, join(name, "pass", p, "sum"), sum, w, GATHER_GAIN);
        change = pm_add(g, change, linear(n, join(name, "pass", p, "own"), n->h, w, 1));
        change = pm_add(g, change, linear(n, join(name, "pass", p, "where"), n->where, w, 1));
        n->h = pm_add(g, n->h, pm_tanh(g, change));
    }
}

// Patterns [size][count] of a field, here of the group number `which` that the network has any of.
static pm_node patterns_of(net *n, int which, int size) {
    char name[32];
    snprintf(name, sizeof name, "field%d.patterns", which);
    return parameter(n, name, (shape_of){size, n->spec->message->patterns, false, 0});
}

// The amplitudes of all fields of the first one's shape in its patterns, and the layers on them.
static void find_amplitudes(net *n) {
    pm_graph *g = n->g;
    const pm_shape first = pm_graph_shape(g, n->field[0]);
    const int size = first.rows * first.cols;
    pm_node amplitude[PM_MAX_FEATURES];
    int count = 0;
    n->hidden = PM_NO_NODE;
    if (n->spec->message->patterns == 0) {
        return;
    }
    for (int i = 0; i < n->spec->nfeature; ++i) {
        if (pm_graph_shape(g, n->field[i]).cols == first.cols) {
            const pm_node row = pm_reshape(g, n->field[i], 1, size);
            const pm_node sum = pm_matmul(g, row, false, patterns_of(n, 0, size), false);
            amplitude[count++] = pm_scale(g, sum, 1.0 / size);
        }
    }
    n->hidden = pm_concat(g, count, amplitude);
    for (int i = 0; i < n->spec->nhidden; ++i) {
        parameter_name name;
        const pm_node x =
            linear(n, join(name, "layer", i, "weight"), n->hidden, n->spec->hidden[i], 1);
        n->hidden = pm_tanh(g, add_bias(n, join(name, "layer", i, "bias"), x));
    }
}

// --- decode ---

// Outputs that are proportional to a driver.
typedef struct driven {
    pm_node local;    // [nnode][width] what messages made of it
    pm_node together; // [1][..] its work on patterns, its products with the first field, and
                      // combinations of these times n->hidden; PM_NO_NODE: no patterns
} driven;

static void drive_locally(net *n, pm_node force, driven *d) {
    pm_graph *g = n->g;
    const int w = n->width;
    const pm_node place =
        pm_tanh(g, add_bias(n, "drive.bias", linear(n, "drive.where", n->where, w, 0.5)));
    d->local = pm_mul(g, linear(n, "drive.force", force, w, 1), pm_offset(g, place, 1));
    for (int p = 0; p < n->spec->message->passes; ++p) {
        parameter_name name;
        const pm_node ends[2] = {n->h, n->where};
        const pm_node both = pm_concat(g, 2, ends);
        pm_node at_target = linear(n, join(name, "drive", p, "target"), both, w, 1);
        at_target = add_bias(n, join(name, "drive", p, "bias"), at_target);
        const pm_node at_source = linear(n, join(name, "drive", p, "source"), both, w, 1);
        const pm_node gate = pm_tanh(g, gather_edges(n, "drive", p, at_source, at_target));
        const pm_node carried = linear(n, join(name, "drive", p, "carried"), d->local, w, 1);
        const pm_node message =
            pm_mul(g, gate, pm_gather_rows(g, carried, n->mesh->nedge, n->mesh->source));
        const pm_node sum = scatter_edges(n, message);
        d->local =
            pm_add(g, d->local, linear(n, join(name, "drive", p, "sum"), sum, w, GATHER_GAIN));
    }
}

// Each component of the force times each of the first field, weighted by learned functions of the
// place and summed over the nodes: [1][LEVERS cols^2].
static pm_node levers(net *n, pm_node force) {
    pm_graph *g = n->g;
    const int cols = pm_graph_shape(g, n->field[0]).cols;
    const pm_node place =
        add_bias(n, "lever.bias", linear(n, "lever.where", n->where, LEVERS, 0.5));
    pm_node moment[PM_MAX_FEATURES];
    for (int c = 0; c < cols; ++c) {
        moment[c] = pm_mul(g, force, pm_slice(g, n->field[0], c, 1));
    }
    const pm_node sum = pm_matmul(g, place, true, pm_concat(g, cols, moment), false);
    const pm_shape shape = pm_graph_shape(g, sum);
    return pm_reshape(g, pm_scale(g, sum, 1 / sqrt(n->mesh->nnode)), 1, shape.rows * shape.cols);
}

static void drive_together(net *n, pm_node force, driven *d) {
    pm_graph *g = n->g;
    d->together = PM_NO_NODE;
    if (n->hidden == PM_NO_NODE) {
        return;
    }
    const pm_shape shape = pm_graph_shape(g, force);
    const int size = shape.rows * shape.cols;
    const pm_node work =
        pm_matmul(g, pm_reshape(g, force, 1, size), false, patterns_of(n, 0, size), false);
    pm_node part[3] = {pm_scale(g, work, 1 / sqrt(size)), levers(n, force)};
    const pm_node drive = pm_concat(g, 2, part);
    const int width = pm_graph_shape(g, n->hidden).cols;
    part[2] = pm_mul(g, n->hidden, linear(n, "together.weight", drive, width, 0.5));
    d->together = pm_concat(g, 3, part);
}

// Output field number k [nnode][cols] in units of its typical component.
static pm_node decode_field(net *n, int k, int cols, const driven *d) {
    pm_graph *g = n->g;
    parameter_name name;
    const pm_node local = d != NULL ? d->local : n->h;
    pm_node out = linear(n, join(name, "out", k, "local"), local, cols, DECODE_GAIN);
    if (d != NULL) {
        const pm_node ends[2] = {n->h, n->where};
        const pm_node gate =
            linear(n, join(name, "out", k, "gate"), pm_concat(g, 2, ends), n->width, 1);
        const pm_node gated = pm_mul(g, local, pm_tanh(g, gate));
        out = pm_add(g, out, linear(n, join(name, "out", k, "gated"), gated, cols, DECODE_GAIN));
    }
    const pm_node together = d != NULL ? d->together : n->hidden;
    if (together != PM_NO_NODE) {
        const int size = n->mesh->nnode * cols, count = n->spec->message->patterns;
        const pm_node amplitude =
            linear(n, join(name, "out", k, "together"), together, count, DECODE_GAIN);
        const pm_node sum = pm_matmul(g, amplitude, false, patterns_of(n, k, size), true);
        out = pm_add(g, out, pm_reshape(g, sum, n->mesh->nnode, cols));
    }
    return out;
}

// --- the three kinds of outputs ---

static net begin(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                 const pm_params *params, const char *prefix, pm_params *declaring) {
    net n = {.g = g,
             .spec = spec,
             .mesh = spec->message->mesh,
             .width = spec->message->width,
             .prefix = prefix,
             .params = params,
             .declaring = declaring,
             .symbols = symbols};
    encode(&n);
    process(&n);
    return n;
}

static pm_node build_fields(net *n, pm_fields out) {
    pm_graph *g = n->g;
    driven d, *driver = NULL;
    find_amplitudes(n);
    if (n->spec->message->driver != NULL) {
        const pm_node force = scaled_field(n, n->spec->nfeature, n->spec->message->driver);
        drive_locally(n, force, &d);
        drive_together(n, force, &d);
        driver = &d;
    }
    pm_node rate[2 * PM_MAX_GROUPS];
    const pm_node unit = parameter(n, "out.along", (shape_of){1, out.count, false, 0});
    for (int k = 0; k < out.count; ++k) {
        const int size = size_of(n->symbols, out.name[k]);
        const pm_node x = decode_field(n, k, size / n->mesh->nnode, driver);
        const double factor = 1 / (n->spec->message->within * sqrt(size));
        rate[k] =
            pm_scale(g, pm_mul(g, pm_reshape(g, x, 1, size), pm_slice(g, unit, k, 1)), factor);
    }
    return pm_concat(g, out.count, rate);
}

static pm_node build_sum(net *n) {
    pm_graph *g = n->g;
    find_amplitudes(n);
    const pm_node each = linear(n, "decode.weight", n->h, 1, DECODE_GAIN);
    pm_node sum = pm_sum_to(g, pm_scale(g, each, 1.0 / n->mesh->nnode), (pm_shape){true, 1, 1});
    if (n->hidden != PM_NO_NODE) {
        sum = pm_add(g, sum, linear(n, "together.weight", n->hidden, 1, DECODE_GAIN));
    }
    const pm_node along = parameter(n, "along", (shape_of){1, n->spec->nfeature, false, 0});
    return pm_mul(g, sum, pm_square(g, pm_slice(g, along, 0, 1)));
}

static pm_node build_nodes(net *n, int nout) {
    const pm_node out = linear(n, "decode.weight", n->h, nout, DECODE_GAIN);
    const shape_of bias = {1, nout, true, 0};
    return pm_add(n->g, out, parameter(n, "decode.bias", bias));
}

pm_node pm_message_build_fields(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                                pm_fields out, const pm_params *params, const char *prefix) {
    net n = begin(g, spec, symbols, params, prefix, NULL);
    return build_fields(&n, out);
}

pm_node pm_message_build_sum(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                             const pm_params *params, const char *prefix) {
    net n = begin(g, spec, symbols, params, prefix, NULL);
    return build_sum(&n);
}

pm_node pm_message_build_nodes(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                               int nout, const pm_params *params, const char *prefix) {
    net n = begin(g, spec, symbols, params, prefix, NULL);
    return build_nodes(&n, nout);
}

// --- declaration ---

static bool is_group(const pm_symbols *symbols, const char *name) {
    for (int i = 0; i < symbols->count; ++i) {
        if (strcmp(symbols->symbol[i].name, name) == 0) {
            return true;
        }
    }
    return false;
}

static pm_status check_field(const pm_network_spec *spec, const pm_symbols *symbols,
                             const char *name) {
    int size = 0;
    PM_TRY(pm_feature_size(name, symbols, &size));
    const int nnode = spec->message->mesh->nnode, patterns = spec->message->patterns;
    if (!is_group(symbols, name)) {
        return pm_fail(PM_ECONFIG, "\"%s\" is an expression, expected a group", name);
    }
    if (size % nnode != 0) {
        return pm_fail(PM_ECONFIG,
                       "\"%s\" has %d components, which is no field on a mesh of %d nodes", name,
                       size, nnode);
    }
    return (double)size * patterns <= MOST_NUMBERS
               ? PM_OK
               : pm_fail(PM_ECONFIG, "%d patterns of %d components: more than %d numbers", patterns,
                         size, MOST_NUMBERS);
}

static pm_status check_sizes(const pm_network_spec *spec) {
    const pm_message_spec *m = spec->message;
    if ((double)m->mesh->nedge * m->width * (m->passes + 1) > MOST_NUMBERS) {
        return pm_fail(PM_ECONFIG, "%d numbers over %d edges in %d passes: more than %d in all",
                       m->width, m->mesh->nedge, m->passes, MOST_NUMBERS);
    }
    if (spec->nfeature + (m->driver != NULL) > PM_MAX_FEATURES) {
        return pm_fail(PM_ECONFIG, "more than %d fields", PM_MAX_FEATURES);
    }
    return spec->nhidden == 0 || m->patterns > 0
               ? PM_OK
               : pm_fail(PM_ECONFIG, "hidden layers are of patterns, and there are none");
}

static pm_status check_driver(const pm_network_spec *spec, const pm_symbols *symbols) {
    const pm_message_spec *m = spec->message;
    PM_TRY(check_field(spec, symbols, m->driver));
    for (int i = 0; i < spec->nfeature; ++i) {
        if (strcmp(spec->feature[i], m->driver) == 0) {
            return pm_fail(PM_ECONFIG, "driven_by \"%s\": a driver cannot be one of nodes too",
                           m->driver);
        }
    }
    const int size = size_of(symbols, m->driver), components = size / m->mesh->nnode;
    if (size != size_of(symbols, spec->feature[0])) {
        return pm_fail(PM_ECONFIG, "driven_by \"%s\": expected a field like the first of nodes",
                       m->driver);
    }
    return m->patterns == 0 || components <= PM_MAX_FEATURES
               ? PM_OK
               : pm_fail(PM_ECONFIG,
                         "driven_by \"%s\": %d components per node, at most %d with patterns",
                         m->driver, components, PM_MAX_FEATURES);
}

static pm_status check(const pm_network_spec *spec, const pm_symbols *symbols, bool is_rate) {
    PM_TRY(check_sizes(spec));
    for (int i = 0; i < spec->nfeature; ++i) {
        PM_TRY(check_field(spec, symbols, spec->feature[i]));
    }
    if (!is_rate && spec->message->within != 1) {
        return pm_fail(PM_ECONFIG, "only a rate has within");
    }
    if (spec->message->driver == NULL) {
        return PM_OK;
    }
    return is_rate ? check_driver(spec, symbols)
                   : pm_fail(PM_ECONFIG, "only a rate can be driven_by a field");
}

static pm_status check_out(const pm_network_spec *spec, const pm_symbols *symbols, pm_fields out) {
    PM_TRY(check(spec, symbols, true));
    for (int k = 0; k < out.count; ++k) {
        PM_TRY(check_field(spec, symbols, out.name[k]));
    }
    return strcmp(out.name[0], spec->feature[0]) == 0
               ? PM_OK
               : pm_fail(PM_ECONFIG, "the first of nodes must be \"%s\", whose rate this is",
                         out.name[0]);
}

// A network on a graph of its own.
static pm_status begin_declaring(net *n, const pm_network_spec *spec, const pm_symbols *symbols,
                                 pm_params *params, const char *prefix) {
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    *n = begin(g, spec, symbols, params, prefix, params);
    return PM_OK;
}

static pm_status end_declaring(net *n) {
    if (pm_graph_exhausted(n->g)) { // then no shape was right
        n->status = pm_fail(PM_ENOMEM, "out of memory for the graph of a network");
    }
    pm_graph_close(n->g);
    return n->status;
}

pm_status pm_message_declare_fields(const pm_network_spec *spec, const pm_symbols *symbols,
                                    pm_fields out, pm_params *params, const char *prefix) {
    PM_TRY(pm_spec_locate(spec->at, check_out(spec, symbols, out)));
    net n;
    PM_TRY(begin_declaring(&n, spec, symbols, params, prefix));
    build_fields(&n, out);
    return end_declaring(&n);
}

pm_status pm_message_declare_sum(const pm_network_spec *spec, const pm_symbols *symbols,
                                 pm_params *params, const char *prefix) {
    PM_TRY(pm_spec_locate(spec->at, check(spec, symbols, false)));
    net n;
    PM_TRY(begin_declaring(&n, spec, symbols, params, prefix));
    build_sum(&n);
    return end_declaring(&n);
}

static pm_status check_nodes(const pm_network_spec *spec, const pm_symbols *symbols, int nout) {
    PM_TRY(check(spec, symbols, false));
    if (spec->message->patterns > 0) {
        return pm_fail(PM_ECONFIG, "an operator on a mesh has no patterns");
    }
    return (double)spec->message->mesh->nnode * nout <= MOST_NUMBERS
               ? PM_OK
               : pm_fail(PM_ECONFIG, "matrices of %d entries at %d nodes: more than %d numbers",
                         nout, spec->message->mesh->nnode, MOST_NUMBERS);
}

pm_status pm_message_declare_nodes(const pm_network_spec *spec, const pm_symbols *symbols, int nout,
                                   pm_params *params, const char *prefix) {
    PM_TRY(pm_spec_locate(spec->at, check_nodes(spec, symbols, nout)));
    net n;
    PM_TRY(begin_declaring(&n, spec, symbols, params, prefix));
    build_nodes(&n, nout);
    return end_declaring(&n);
}

// --- constants fixed from the data ---

static pm_status visit_patterns(const pm_symbols *symbols, int which, const char *const *name,
                                const char *prefix, pm_normaliser_visit *visit, void *context) {
    parameter_name full;
    snprintf(full, sizeof full, "%s.field%d", prefix, which);
    const pm_normaliser patterns = {.kind = PM_NORMALISE_PATTERNS,
                                    .prefix = full,
                                    .count = 1,
                                    .expression = name,
                                    .symbols = symbols};
    return visit(context, &patterns);
}

static pm_status visit_inputs(const pm_network_spec *spec, const pm_symbols *symbols,
                              const char *prefix, pm_normaliser_visit *visit, void *context) {
    const char *name[PM_MAX_FEATURES];
    int count = 0;
    for (; count < spec->nfeature; ++count) {
        name[count] = spec->feature[count];
    }
    if (spec->message->driver != NULL) {
        name[count++] = spec->message->driver;
    }
    const pm_normaliser along = {.kind = PM_NORMALISE_ALONG,
                                 .prefix = prefix,
                                 .count = count,
                                 .expression = name,
                                 .symbols = symbols};
    return visit(context, &along);
}

pm_status pm_message_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context) {
    PM_TRY(visit_inputs(spec, symbols, prefix, visit, context));
    return spec->message->patterns == 0
               ? PM_OK
               : visit_patterns(symbols, 0, spec->feature, prefix, visit, context);
}

pm_status pm_message_visit_fields(const pm_network_spec *spec, const pm_symbols *symbols,
                                  pm_fields out, const char *prefix, pm_normaliser_visit *visit,
                                  void *context) {
    parameter_name full;
    snprintf(full, sizeof full, "%s.out", prefix);
    const pm_normaliser along = {.kind = PM_NORMALISE_ALONG,
                                 .prefix = full,
                                 .count = out.count,
                                 .expression = out.name,
                                 .symbols = symbols};
    PM_TRY(visit_inputs(spec, symbols, prefix, visit, context));
    PM_TRY(visit(context, &along));
    for (int k = 0; k < out.count && spec->message->patterns > 0; ++k) {
        PM_TRY(visit_patterns(symbols, k, &out.name[k], prefix, visit, context));
    }
    return PM_OK;
}
