// The last stage of a network on a mesh: from the hidden states of the nodes to its outputs.
#include <math.h>
#include <stdio.h>

#include "graph/node.h"
#include "model/mesh/message_net.h"

// Decoders start small, so that training starts near the given terms alone.
#define DECODE_GAIN 0.03
// Number of learned functions of the position. They weight the products of the driver and the first
// field.
#define LEVERS 6

// --- patterns ---

// Returns the patterns [size][count] of field number `which`.
static pm_node patterns_of(pm_message_net *n, int which, int size) {
    char name[32];
    snprintf(name, sizeof name, "field%d.patterns", which);
    return pm_message_parameter(n, name,
                                (pm_message_shape){size, n->spec->message->patterns, false, 0});
}

// Computes the amplitudes, in the patterns of the first field, of all fields of its shape, and the
// hidden layers on them.
static void find_amplitudes(pm_message_net *n) {
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
        pm_message_name name;
        const pm_node x = pm_message_linear(n, pm_message_join(name, "layer", i, "weight"),
                                            n->hidden, n->spec->hidden[i], 1);
        n->hidden = pm_tanh(g, pm_message_bias(n, pm_message_join(name, "layer", i, "bias"), x));
    }
}

// --- decode ---

// The inputs of the decoders where the outputs are proportional to a driver.
typedef struct driven_outputs {
    pm_node local; // [nnode][width] the driver after all message passes
    // [1][..] its work on the patterns, its products with the first field, and combinations of
    // these times n->hidden; PM_NO_NODE: no patterns.
    pm_node together;
} driven_outputs;

static void drive_locally(pm_message_net *n, pm_node force, driven_outputs *d) {
    pm_graph *g = n->g;
    const int w = n->width;
    const pm_node place = pm_tanh(
        g, pm_message_bias(n, "drive.bias", pm_message_linear(n, "drive.where", n->where, w, 0.5)));
    d->local = pm_mul(g, pm_message_linear(n, "drive.force", force, w, 1), pm_offset(g, place, 1));
    for (int p = 0; p < n->spec->message->passes; ++p) {
        pm_message_name name;
        const pm_node ends[2] = {n->h, n->where};
        const pm_node both = pm_concat(g, 2, ends);
        pm_node at_target =
            pm_message_linear(n, pm_message_join(name, "drive", p, "target"), both, w, 1);
        at_target = pm_message_bias(n, pm_message_join(name, "drive", p, "bias"), at_target);
        const pm_node at_source =
            pm_message_linear(n, pm_message_join(name, "drive", p, "source"), both, w, 1);
        const pm_node gate = pm_tanh(g, pm_message_gather(n, "drive", p, at_source, at_target));
        const pm_node carried =
            pm_message_linear(n, pm_message_join(name, "drive", p, "carried"), d->local, w, 1);
        const pm_node message =
            pm_mul(g, gate, pm_gather_rows(g, carried, n->mesh->nedge, n->mesh->source));
        const pm_node sum = pm_message_scatter(n, message);
        d->local = pm_add(g, d->local,
                          pm_message_linear(n, pm_message_join(name, "drive", p, "sum"), sum, w,
                                            PM_MESSAGE_GATHER_GAIN));
    }
}

// Returns each component of the force times each one of the first field, weighted by learned
// functions of the place and summed over the nodes: [1][LEVERS cols^2].
static pm_node levers(pm_message_net *n, pm_node force) {
    pm_graph *g = n->g;
    const int cols = pm_graph_shape(g, n->field[0]).cols;
    const pm_node place = pm_message_bias(
        n, "lever.bias", pm_message_linear(n, "lever.where", n->where, LEVERS, 0.5));
    pm_node moment[PM_MAX_FEATURES];
    for (int c = 0; c < cols; ++c) {
        moment[c] = pm_mul(g, force, pm_slice(g, n->field[0], c, 1));
    }
    const pm_node sum = pm_matmul(g, place, true, pm_concat(g, cols, moment), false);
    const pm_shape shape = pm_graph_shape(g, sum);
    return pm_reshape(g, pm_scale(g, sum, 1 / sqrt(n->mesh->nnode)), 1, shape.rows * shape.cols);
}

static void drive_together(pm_message_net *n, pm_node force, driven_outputs *d) {
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
    part[2] = pm_mul(g, n->hidden, pm_message_linear(n, "together.weight", drive, width, 0.5));
    d->together = pm_concat(g, 3, part);
}

// Returns output field number k [nnode][cols] in units of its typical component.
static pm_node decode_field(pm_message_net *n, int k, int cols, const driven_outputs *d) {
    pm_graph *g = n->g;
    pm_message_name name;
    const pm_node local = d != NULL ? d->local : n->h;
    pm_node out =
        pm_message_linear(n, pm_message_join(name, "out", k, "local"), local, cols, DECODE_GAIN);
    if (d != NULL) {
        const pm_node ends[2] = {n->h, n->where};
        const pm_node gate = pm_message_linear(n, pm_message_join(name, "out", k, "gate"),
                                               pm_concat(g, 2, ends), n->width, 1);
        const pm_node gated = pm_mul(g, local, pm_tanh(g, gate));
        out = pm_add(g, out,
                     pm_message_linear(n, pm_message_join(name, "out", k, "gated"), gated, cols,
                                       DECODE_GAIN));
    }
    const pm_node together = d != NULL ? d->together : n->hidden;
    if (together != PM_NO_NODE) {
        const int size = n->mesh->nnode * cols, count = n->spec->message->patterns;
        const pm_node amplitude = pm_message_linear(n, pm_message_join(name, "out", k, "together"),
                                                    together, count, DECODE_GAIN);
        const pm_node sum = pm_matmul(g, amplitude, false, patterns_of(n, k, size), true);
        out = pm_add(g, out, pm_reshape(g, sum, n->mesh->nnode, cols));
    }
    return out;
}

// --- the three kinds of outputs ---

pm_node pm_message_decode_fields(pm_message_net *n, pm_fields out) {
    pm_graph *g = n->g;
    driven_outputs d, *driver = NULL;
    find_amplitudes(n);
    if (n->spec->message->driver != NULL) {
        const pm_node force = pm_message_field(n, n->spec->nfeature, n->spec->message->driver);
        drive_locally(n, force, &d);
        drive_together(n, force, &d);
        driver = &d;
    }
    pm_node rate[2 * PM_MAX_GROUPS];
    const pm_node unit =
        pm_message_parameter(n, "out.along", (pm_message_shape){1, out.count, false, 0});
    for (int k = 0; k < out.count; ++k) {
        const int size = pm_message_field_size(n->symbols, out.name[k]);
        const pm_node x = decode_field(n, k, size / n->mesh->nnode, driver);
        const double factor = 1 / (n->spec->message->within * sqrt(size));
        rate[k] =
            pm_scale(g, pm_mul(g, pm_reshape(g, x, 1, size), pm_slice(g, unit, k, 1)), factor);
    }
    return pm_concat(g, out.count, rate);
}

pm_node pm_message_decode_sum(pm_message_net *n) {
    pm_graph *g = n->g;
    find_amplitudes(n);
    const pm_node each = pm_message_linear(n, "decode.weight", n->h, 1, DECODE_GAIN);
    pm_node sum = pm_sum_to(g, pm_scale(g, each, 1.0 / n->mesh->nnode), (pm_shape){true, 1, 1});
    if (n->hidden != PM_NO_NODE) {
        sum = pm_add(g, sum, pm_message_linear(n, "together.weight", n->hidden, 1, DECODE_GAIN));
    }
    const pm_node along =
        pm_message_parameter(n, "along", (pm_message_shape){1, n->spec->nfeature, false, 0});
    return pm_mul(g, sum, pm_square(g, pm_slice(g, along, 0, 1)));
}

pm_node pm_message_decode_nodes(pm_message_net *n, int nout) {
    const pm_node out = pm_message_linear(n, "decode.weight", n->h, nout, DECODE_GAIN);
    const pm_message_shape bias = {1, nout, true, 0};
    return pm_add(n->g, out, pm_message_parameter(n, "decode.bias", bias));
}
