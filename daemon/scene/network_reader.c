// Reads networks from YAML, and writes them.
#include "scene/network_reader.h"

#define MAX_LAYERS 16
#define MAX_WIDTH 4096 // of a hidden layer

static const char *const activation_names[] = {
    [PM_TANH] = "tanh", [PM_SOFTPLUS] = "softplus", [PM_SILU] = "silu", NULL};
static const char *const skip_names[] = {[PM_SKIP_NONE] = "none",
                                         [PM_SKIP_LINEAR] = "linear",
                                         [PM_SKIP_QUADRATIC] = "quadratic",
                                         [PM_SKIP_QUARTIC] = "quartic",
                                         NULL};

static pm_status read_features(pm_yaml block, pm_arena *arena, pm_network_spec *network) {
    int activation, skip;
    PM_TRY(pm_model_read_names(block, "features", arena, &network->nfeature, &network->feature));
    PM_TRY(pm_model_read_choice(block, "activation", activation_names, &activation));
    PM_TRY(pm_model_read_choice(block, "skip", skip_names, &skip));
    network->activation = (pm_activation)activation;
    network->skip = (pm_skip)skip;
    return PM_OK;
}

pm_status pm_network_read(pm_yaml block, pm_arena *arena, pm_network_spec *network) {
    *network = (pm_network_spec){0};
    const pm_yaml features = pm_yaml_get(block, "features");
    PM_TRY(pm_model_read_at(pm_yaml_exists(features) ? features : block, arena, &network->at));
    PM_TRY(read_features(block, arena, network));
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

void pm_network_write(FILE *file, const pm_network_spec *network) {
    pm_model_write_names(file, "features", network->nfeature, network->feature);
    fputs(", hidden: [", file);
    for (int i = 0; i < network->nhidden; ++i) {
        fprintf(file, "%s%d", i == 0 ? "" : ", ", network->hidden[i]);
    }
    fprintf(file, "], activation: %s, skip: %s%s", activation_names[network->activation],
            skip_names[network->skip], network->zero_at_origin ? ", zero_at_origin: true" : "");
}
