// The first two stages of a network on a mesh, encode and process, and the parameters of all
// stages. A network is described once, by the functions that build it: to declare its parameters it
// is built on a graph that is thrown away. Parameters draw their initial values in the order of
// declaration. Therefore no call has two arguments that declare any, since C leaves their order
// open.
#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "graph/node.h"
#include "model/mesh/message_net.h"

#define BIAS_SPREAD 0.5 // standard deviation of initial biases
// Differences between neighbours are small compared with the fields; this gain compensates for
// that.
#define DIFFERENCE_GAIN 3.0

// --- parameters ---

pm_node pm_message_parameter(pm_message_net *n, const char *name, pm_message_shape s) {
    pm_message_name full;
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

pm_node pm_message_linear(pm_message_net *n, const char *name, pm_node x, int nout, double gain) {
    const int nin = pm_graph_shape(n->g, x).cols;
    const pm_message_shape s = {nin, nout, true, gain / sqrt(nin)};
    return pm_matmul(n->g, x, false, pm_message_parameter(n, name, s), false);
}

pm_node pm_message_bias(pm_message_net *n, const char *name, pm_node x) {
    const pm_message_shape s = {1, pm_graph_shape(n->g, x).cols, true, BIAS_SPREAD};
    return pm_add(n->g, x, pm_message_parameter(n, name, s));
}

// Returns features of the mesh as a parameter, which is filled when it is declared. Later it is
// read from a weights file.
static pm_node pm_message_mesh_features(pm_message_net *n, const char *name, int rows, int cols,
                                        void (*fill)(const pm_mesh *, double *)) {
    pm_message_name full;
    snprintf(full, sizeof full, "%s.%s", n->prefix, name);
    const bool fresh = pm_params_find(n->params, full) == NULL;
    const pm_node node = pm_message_parameter(n, name, (pm_message_shape){rows, cols, false, 0});
    pm_param_entry *entry = pm_params_find(n->params, full);
    if (fresh && entry != NULL) {
        fill(n->mesh, entry->value);
    }
    return node;
}

// --- encode ---

int pm_message_field_size(const pm_symbols *symbols, const char *name) {
    int size = 0;
    (void)pm_feature_size(name, symbols, &size);
    return size;
}

// Returns the value of a group [1][size]. While parameters are declared the value is not known, and
// the function returns an input.
static pm_node value_of(pm_message_net *n, const char *name) {
    if (n->declaring == NULL) {
        return pm_feature_build(n->g, name, n->symbols);
    }
    return pm_input(n->g, true, 1, pm_message_field_size(n->symbols, name));
}

pm_node pm_message_field(pm_message_net *n, int which, const char *name) {
    const int count = n->spec->nfeature + (n->spec->message->driver != NULL);
    const pm_node along = pm_message_parameter(n, "along", (pm_message_shape){1, count, false, 0});
    const pm_node x = value_of(n, name);
    const int size = pm_graph_shape(n->g, x).cols;
    const pm_node length = pm_slice(n->g, along, which, 1);
    const pm_node scaled = pm_div(n->g, pm_scale(n->g, x, sqrt(size)), length);
    return pm_reshape(n->g, scaled, n->mesh->nnode, size / n->mesh->nnode);
}

static void encode(pm_message_net *n) {
    pm_graph *g = n->g;
    const pm_node position = pm_message_mesh_features(n, "position", n->mesh->nnode,
                                                      PM_MESH_NODE_FEATURES, pm_mesh_node_features);
    const pm_node near = pm_tanh(
        g, pm_message_bias(n, "where0.bias",
                           pm_message_linear(n, "where0.weight", position, 2 * n->width, 2)));
    n->where =
        pm_tanh(g, pm_message_bias(n, "where1.bias",
                                   pm_message_linear(n, "where1.weight", near, n->width, 1)));
    for (int i = 0; i < n->spec->nfeature; ++i) {
        n->field[i] = pm_message_field(n, i, n->spec->feature[i]);
    }
    const pm_node fields = pm_concat(g, n->spec->nfeature, n->field);
    const pm_node by_place = pm_message_linear(n, "encode.where", n->where, n->width, 1);
    const pm_node by_field = pm_message_linear(n, "encode.field", fields, n->width, 1);
    n->h = pm_tanh(g, pm_message_bias(n, "encode.bias", pm_add(g, by_field, by_place)));
}

// --- process ---

const char *pm_message_join(pm_message_name buffer, const char *stage, int pass, const char *name) {
    snprintf(buffer, sizeof(pm_message_name), "%s%d.%s", stage, pass, name);
    return buffer;
}

pm_node pm_message_gather(pm_message_net *n, const char *stage, int pass, pm_node at_source,
                          pm_node at_target) {
    pm_graph *g = n->g;
    const pm_mesh *m = n->mesh;
    pm_message_name name;
    const pm_node edge = pm_message_mesh_features(n, "edge", PM_MESH_DIRECTIONS,
                                                  PM_MESH_EDGE_FEATURES, pm_mesh_edge_features);
    const pm_node direction =
        pm_message_linear(n, pm_message_join(name, stage, pass, "edge"), edge, n->width, 2);
    const pm_node ends = pm_add(g, pm_gather_rows(g, at_source, m->nedge, m->source),
                                pm_gather_rows(g, at_target, m->nedge, m->target));
    return pm_add(g, ends, pm_gather_rows(g, direction, m->nedge, m->direction));
}

pm_node pm_message_scatter(pm_message_net *n, pm_node messages) {
    return pm_scatter_add_rows(n->g, messages, n->mesh->nnode, n->mesh->nedge, n->mesh->target);
}

static void process(pm_message_net *n) {
    pm_graph *g = n->g;
    const int w = n->width;
    for (int p = 0; p < n->spec->message->passes; ++p) {
        pm_message_name name;
        const pm_node difference = pm_message_linear(
            n, pm_message_join(name, "pass", p, "difference"), n->field[0], w, DIFFERENCE_GAIN);
        const pm_node at_source =
            pm_add(g, pm_message_linear(n, pm_message_join(name, "pass", p, "source"), n->h, w, 1),
                   difference);
        const pm_node at_target =
            pm_sub(g, pm_message_linear(n, pm_message_join(name, "pass", p, "target"), n->h, w, 1),
                   difference);
        const pm_node biased =
            pm_message_bias(n, pm_message_join(name, "pass", p, "bias"), at_target);
        const pm_node message = pm_tanh(g, pm_message_gather(n, "pass", p, at_source, biased));
        const pm_node sum = pm_message_scatter(n, message);
        pm_node change = pm_message_linear(n, pm_message_join(name, "pass", p, "sum"), sum, w,
                                           PM_MESSAGE_GATHER_GAIN);
        change = pm_add(g, change,
                        pm_message_linear(n, pm_message_join(name, "pass", p, "own"), n->h, w, 1));
        change =
            pm_add(g, change,
                   pm_message_linear(n, pm_message_join(name, "pass", p, "where"), n->where, w, 1));
        n->h = pm_add(g, n->h, pm_tanh(g, change));
    }
}

pm_message_net pm_message_begin(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                                const pm_params *params, const char *prefix, pm_params *declaring) {
    pm_message_net n = {.g = g,
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
