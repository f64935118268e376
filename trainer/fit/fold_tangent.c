// Computes f(x) - f(0) - f'(0) x. The linear skip acts on normalised features (x - mean)/deviation,
// so that slopes are multiplied by the deviation.
#include "fit/fold_tangent.h"

#include <stdio.h>
#include <string.h>

#include "graph/program.h"

static double *numbers_of(const pm_part *part, const char *prefix, const char *name) {
    char full[128];
    snprintf(full, sizeof full, "%s.%s", prefix, name);
    return pm_params_find(&part->params, full)->value;
}

static pm_status fold_network(const pm_part *part, const pm_network_spec *network,
                              const char *prefix) {
    pm_graph *g = NULL;
    pm_program *program = NULL;
    char mean[128];
    snprintf(mean, sizeof mean, "%s.mean", prefix);
    const int count = pm_params_find(&part->params, mean)->cols;
    pm_status status;
    PM_TRY_DONE(pm_graph_open(&g));
    const pm_node origin = pm_input(g, true, 1, count);
    pm_node out[2] = {pm_network_build_from(g, network, origin, 1, &part->params, prefix),
                      PM_NO_NODE};
    pm_gradient(g, out[0], PM_NO_NODE, 1, &origin, &out[1]);
    PM_TRY_DONE(pm_program_open(&program, g, 2, out, 1));
    memset(pm_program_value(program, origin), 0, (size_t)count * sizeof(double));
    pm_program_run(program, 1);
    // Subtracts the value and the slope at zero features from the output bias and the linear skip.
    const double *slope = pm_program_value(program, out[1]);
    const double *center = numbers_of(part, prefix, "mean");
    const double *deviation = numbers_of(part, prefix, "deviation");
    double *linear = numbers_of(part, prefix, "linear");
    double *bias = numbers_of(part, prefix, "output.bias");
    *bias -= (*pm_program_value(program, out[0]));
    for (int i = 0; i < count; ++i) {
        linear[i] -= slope[i] * deviation[i];
        *bias -= slope[i] * center[i];
    }
done:
    pm_program_close(program);
    pm_graph_close(g);
    return status;
}

static pm_status fold_potential(const pm_part *part, pm_potential_spec *potential, const char *name,
                                pm_arena *arena) {
    pm_network_spec *term = pm_arena_array(arena, (size_t)potential->nterm, sizeof *term);
    PM_TRY(pm_arena_status(arena, "networks with zero_at_origin"));
    for (int i = 0; i < potential->nterm; ++i) {
        char prefix[32];
        snprintf(prefix, sizeof prefix, "%s.%d", name, i);
        term[i] = potential->term[i];
        term[i].zero_at_origin = false;
        PM_TRY(potential->term[i].zero_at_origin ? fold_network(part, &term[i], prefix) : PM_OK);
    }
    potential->term = term;
    return PM_OK;
}

pm_status pm_fold_tangent(pm_part *part, pm_arena *arena) {
    PM_TRY(fold_potential(part, &part->spec.energy, "energy", arena));
    return fold_potential(part, &part->spec.entropy, "entropy", arena);
}
