// Reads networks and meshes from YAML, and writes them.
#include "scene/network_reader.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_LAYERS 16
#define MAX_WIDTH 4096 // of a hidden layer
// Limits for networks on a mesh, whose memory is proportional to the number of nodes.
#define MAX_NODE_WIDTH 256
#define MAX_PASSES 64
#define MAX_PATTERNS 256

static const char *const activation_names[] = {
    [PM_TANH] = "tanh", [PM_SOFTPLUS] = "softplus", [PM_SILU] = "silu", NULL};
static const char *const skip_names[] = {[PM_SKIP_NONE] = "none",
                                         [PM_SKIP_LINEAR] = "linear",
                                         [PM_SKIP_QUADRATIC] = "quadratic",
                                         [PM_SKIP_QUARTIC] = "quartic",
                                         NULL};

// --- meshes ---

pm_status pm_mesh_read(pm_yaml block, pm_arena *arena, const pm_mesh **mesh) {
    static const char *const keys[] = {"size", "elements", NULL};
    pm_yaml size, elements;
    int nsize, nelement, *element;
    double *length;
    *mesh = NULL;
    if (!pm_yaml_exists(block)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_yaml_require(block, "size", &size));
    PM_TRY(pm_yaml_require(block, "elements", &elements));
    PM_TRY(pm_yaml_doubles(size, arena, &nsize, &length));
    PM_TRY(pm_yaml_ints(elements, 1, PM_MESH_MOST_NODES, arena, &nelement, &element));
    if (nsize != 3 || nelement != 3) {
        return pm_yaml_fail(nsize != 3 ? size : elements, "expected three numbers: along x, y, z");
    }
    const char *at;
    PM_TRY(pm_model_read_at(block, arena, &at));
    return pm_spec_locate(at, pm_mesh_make(length, element, arena, mesh));
}

void pm_mesh_write(FILE *file, const pm_mesh *mesh) {
    if (mesh == NULL) {
        return;
    }
    fputs("mesh: {size: [", file);
    for (int c = 0; c < 3; ++c) {
        fputs(c == 0 ? "" : ", ", file);
        pm_model_write_number(file, mesh->size[c]);
    }
    fprintf(file, "], elements: [%d, %d, %d]}\n", mesh->elements[0], mesh->elements[1],
            mesh->elements[2]);
}

// --- networks ---

// Reads the keys that only networks on a mesh have.
static pm_status read_message(pm_yaml block, pm_yaml nodes, const pm_mesh *mesh, pm_arena *arena,
                              pm_network_spec *network) {
    static const char *const others[] = {"features", "skip", "activation"};
    pm_yaml value;
    pm_message_spec *m = pm_arena_alloc(arena, sizeof *m);
    if (m == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < 3; ++i) {
        if (pm_yaml_exists(value = pm_yaml_get(block, others[i]))) {
            return pm_yaml_fail(value, "a network of nodes has no %s", others[i]);
        }
    }
    if (mesh == NULL) {
        return pm_yaml_fail(nodes, "a network of nodes needs a \"mesh\" in the model");
    }
    *m = (pm_message_spec){.mesh = mesh, .within = 1};
    PM_TRY(pm_model_read_names(block, "nodes", arena, &network->nfeature, &network->feature));
    if (network->nfeature < 1 || network->nfeature > PM_MAX_FEATURES) {
        return pm_yaml_fail(nodes, "expected 1 to %d fields", PM_MAX_FEATURES);
    }
    PM_TRY(pm_yaml_require(block, "width", &value));
    PM_TRY(pm_yaml_int(value, 1, MAX_NODE_WIDTH, &m->width));
    PM_TRY(pm_yaml_require(block, "passes", &value));
    PM_TRY(pm_yaml_int(value, 0, MAX_PASSES, &m->passes));
    if (pm_yaml_exists(value = pm_yaml_get(block, "patterns"))) {
        PM_TRY(pm_yaml_int(value, 0, MAX_PATTERNS, &m->patterns));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "driven_by"))) {
        PM_TRY(pm_yaml_text(value, arena, &m->driver));
    }
    if (pm_yaml_exists(value = pm_yaml_get(block, "within"))) {
        PM_TRY(pm_yaml_double(value, 0, INFINITY, &m->within));
        if (m->within == 0) {
            return pm_yaml_fail(value, "expected a time > 0");
        }
    }
    network->message = m;
    return PM_OK;
}

static pm_status read_features(pm_yaml block, pm_arena *arena, pm_network_spec *network) {
    static const char *const others[] = {"width", "passes", "patterns", "driven_by", "within"};
    int activation, skip;
    for (size_t i = 0; i < sizeof others / sizeof *others; ++i) {
        const pm_yaml value = pm_yaml_get(block, others[i]);
        if (pm_yaml_exists(value)) {
            return pm_yaml_fail(value, "only a network of nodes has %s", others[i]);
        }
    }
    PM_TRY(pm_model_read_names(block, "features", arena, &network->nfeature, &network->feature));
    PM_TRY(pm_model_read_choice(block, "activation", activation_names, &activation));
    PM_TRY(pm_model_read_choice(block, "skip", skip_names, &skip));
    network->activation = (pm_activation)activation;
    network->skip = (pm_skip)skip;
    return PM_OK;
}

pm_status pm_network_read(pm_yaml block, const pm_mesh *mesh, pm_arena *arena,
                          pm_network_spec *network) {
    *network = (pm_network_spec){0};
    const pm_yaml features = pm_yaml_get(block, "features"), nodes = pm_yaml_get(block, "nodes");
    const pm_yaml inputs = pm_yaml_exists(nodes) ? nodes : features;
    PM_TRY(pm_model_read_at(pm_yaml_exists(inputs) ? inputs : block, arena, &network->at));
    PM_TRY(pm_yaml_exists(nodes) ? read_message(block, nodes, mesh, arena, network)
                                 : read_features(block, arena, network));
    const pm_yaml hidden = pm_yaml_get(block, "hidden");
    if (pm_yaml_exists(hidden)) {
        int *width;
        PM_TRY(pm_yaml_ints(hidden, 1, MAX_WIDTH, arena, &network->nhidden, &width));
        network->hidden = width;
        if (network->nhidden > MAX_LAYERS) {
            return pm_yaml_fail(hidden, "%d layers, at most %d are possible", network->nhidden,
                                MAX_LAYERS);
        }
    }
    return PM_OK;
}

pm_status pm_spec_append_features(pm_network_spec *network, int count, const char *const *name,
                                  pm_arena *arena) {
    const int before = network->nfeature;
    const char **all = pm_arena_array(arena, (size_t)(before + count), sizeof *all);
    if (all == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < before; ++i) {
        all[i] = network->feature[i];
    }
    for (int i = 0; i < count; ++i) {
        all[before + i] = name[i];
    }
    network->feature = all;
    network->nfeature = before + count;
    return PM_OK;
}

static void write_message(FILE *file, const pm_message_spec *m) {
    fprintf(file, ", width: %d, passes: %d, patterns: %d, within: ", m->width, m->passes,
            m->patterns);
    pm_model_write_number(file, m->within);
    if (m->driver != NULL) {
        fputs(", driven_by: ", file);
        pm_model_write_text(file, m->driver);
    }
}

void pm_network_write(FILE *file, const pm_network_spec *network) {
    const bool message = network->message != NULL;
    pm_model_write_names(file, message ? "nodes" : "features", network->nfeature, network->feature);
    fputs(", hidden: [", file);
    for (int i = 0; i < network->nhidden; ++i) {
        fprintf(file, "%s%d", i == 0 ? "" : ", ", network->hidden[i]);
    }
    fputc(']', file);
    if (message) {
        write_message(file, network->message);
    } else {
        fprintf(file, ", activation: %s, skip: %s%s", activation_names[network->activation],
                skip_names[network->skip], network->zero_at_origin ? ", zero_at_origin: true" : "");
    }
}
