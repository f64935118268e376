// Builds the residuals of a sample for Gauss-Newton methods.
#include "learn/residuals.h"

#include <math.h>
#include <stddef.h>

int pm_residuals_count(const pm_objective *objective) {
    const pm_loss_context c = pm_objective_context(objective);
    return c.samples->nz * c.samples->unroll + pm_loss_balances(c.loss, c.system);
}

pm_status pm_residuals_build(pm_graph *g, const pm_loss_context *context, pm_node *input,
                             pm_node *residual) {
    const pm_loss_context *c = context;
    pm_loss_nodes nodes;
    PM_TRY(pm_loss_graph_build(g, c->system, c->samples, c->loss, &nodes));
    *input = nodes.input;
    const int n = pm_graph_shape(g, nodes.residual).cols;
    const pm_node part[2] = {
        pm_scale(g, nodes.residual, 1 / sqrt(n)),
        nodes.degeneracy == PM_NO_NODE ? PM_NO_NODE
                                       : pm_scale(g, nodes.degeneracy, sqrt(c->loss->degeneracy)),
    };
    *residual = pm_concat(g, part[1] == PM_NO_NODE ? 1 : 2, part);
    return PM_OK;
}

int pm_residuals_weights(pm_graph *g, const pm_system *system, pm_node *leaf, int *size) {
    int count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        for (int j = 0; j < params->count; ++j) {
            const pm_param_entry *entry = &params->entry[j];
            if (entry->trained) {
                if (leaf != NULL) {
                    leaf[count] = pm_weight(g, entry->value, entry->rows, entry->cols);
                    size[count] = entry->rows * entry->cols;
                }
                ++count;
            }
        }
    }
    return count;
}
