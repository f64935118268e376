// Declaring and building networks on a mesh. Sizes and names come from files and are checked here.
#include "model/mesh/message.h"

#include <stdio.h>
#include <string.h>

#include "graph/node.h"
#include "model/mesh/message_net.h"

// The most numbers that a network may pass over all edges, hold in patterns, or have in the
// matrices of all nodes. No network of this size can be trained, and any host has the memory.
#define MOST_NUMBERS 16777216

// --- building ---

pm_node pm_message_build_fields(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                                pm_fields out, const pm_params *params, const char *prefix) {
    pm_message_net n = pm_message_begin(g, spec, symbols, params, prefix, NULL);
    return pm_message_decode_fields(&n, out);
}

pm_node pm_message_build_sum(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                             const pm_params *params, const char *prefix) {
    pm_message_net n = pm_message_begin(g, spec, symbols, params, prefix, NULL);
    return pm_message_decode_sum(&n);
}

pm_node pm_message_build_nodes(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                               int nout, const pm_params *params, const char *prefix) {
    pm_message_net n = pm_message_begin(g, spec, symbols, params, prefix, NULL);
    return pm_message_decode_nodes(&n, nout);
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
               : pm_fail(PM_ECONFIG, "hidden layers need patterns, on whose amplitudes they act");
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
    const int size = pm_message_field_size(symbols, m->driver), components = size / m->mesh->nnode;
    if (size != pm_message_field_size(symbols, spec->feature[0])) {
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

// Starts a network on a graph of its own, to declare its parameters.
static pm_status begin_declaring(pm_message_net *n, const pm_network_spec *spec,
                                 const pm_symbols *symbols, pm_params *params, const char *prefix) {
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    *n = pm_message_begin(g, spec, symbols, params, prefix, params);
    return PM_OK;
}

static pm_status end_declaring(pm_message_net *n) {
    if (pm_graph_exhausted(n->g)) { // then no shape was right
        n->status = pm_fail(PM_ENOMEM, "out of memory for the graph of a network");
    }
    pm_graph_close(n->g);
    return n->status;
}

pm_status pm_message_declare_fields(const pm_network_spec *spec, const pm_symbols *symbols,
                                    pm_fields out, pm_params *params, const char *prefix) {
    PM_TRY(pm_spec_locate(spec->at, check_out(spec, symbols, out)));
    pm_message_net n;
    PM_TRY(begin_declaring(&n, spec, symbols, params, prefix));
    pm_message_decode_fields(&n, out);
    return end_declaring(&n);
}

pm_status pm_message_declare_sum(const pm_network_spec *spec, const pm_symbols *symbols,
                                 pm_params *params, const char *prefix) {
    PM_TRY(pm_spec_locate(spec->at, check(spec, symbols, false)));
    pm_message_net n;
    PM_TRY(begin_declaring(&n, spec, symbols, params, prefix));
    pm_message_decode_sum(&n);
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
    pm_message_net n;
    PM_TRY(begin_declaring(&n, spec, symbols, params, prefix));
    pm_message_decode_nodes(&n, nout);
    return end_declaring(&n);
}

// --- constants fixed from the data ---

static pm_status visit_patterns(const pm_symbols *symbols, int which, const char *const *name,
                                const char *prefix, pm_normaliser_visit *visit, void *context) {
    pm_message_name full;
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
    pm_message_name full;
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
