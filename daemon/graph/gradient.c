// Reverse accumulation: walks from the result to the leaves and adds up adjoints, building graph
// nodes only for operands that lead to something asked for.
#include <assert.h>
#include <stdlib.h>

#include "graph/node.h"

// leads[x]: x depends on one of the wanted nodes (or is one).
static void mark_leading(const pm_graph *g, pm_node last, int count, const pm_node *wanted,
                         bool *leads) {
    for (int i = 0; i < count; ++i) {
        if (wanted[i] != PM_NO_NODE && wanted[i] <= last) {
            leads[wanted[i]] = true;
        }
    }
    for (pm_node x = 0; x <= last; ++x) {
        const pm_graph_node *node = pm_graph_node_at(g, x);
        for (int i = 0; i < node->noperand && !leads[x]; ++i) {
            leads[x] = leads[node->operand[i]];
        }
    }
}

static void accumulate(pm_graph *g, pm_node last, const bool *leads, pm_node *adjoint) {
    for (pm_node x = last; x >= 0; --x) {
        if (adjoint[x] == PM_NO_NODE || !leads[x]) {
            continue;
        }
        const pm_op op = pm_graph_node_at(g, x)->op;
        const int noperand = pm_graph_node_at(g, x)->noperand;
        for (int i = 0; i < noperand; ++i) {
            const pm_node operand = pm_graph_node_at(g, x)->operand[i];
            if (leads[operand]) {
                const pm_node term = pm_operations[op].adjoint(g, x, adjoint[x], i);
                adjoint[operand] = pm_add_or(g, adjoint[operand], term);
            }
        }
    }
}

void pm_gradient(pm_graph *g, pm_node y, pm_node seed, int count, const pm_node *x, pm_node *dx) {
    for (int i = 0; i < count; ++i) {
        dx[i] = PM_NO_NODE;
    }
    if (y == PM_NO_NODE || pm_graph_exhausted(g)) {
        return;
    }
    bool *leads = calloc((size_t)y + 1, sizeof *leads);
    pm_node *adjoint = malloc(((size_t)y + 1) * sizeof *adjoint);
    if (leads == NULL || adjoint == NULL) {
        pm_graph_exhaust(g);
        goto done;
    }
    for (pm_node i = 0; i <= y; ++i) {
        adjoint[i] = PM_NO_NODE;
    }
    mark_leading(g, y, count, x, leads);
    if (leads[y]) {
        const pm_shape shape = pm_graph_shape(g, y);
        adjoint[y] = seed != PM_NO_NODE ? seed : pm_broadcast_to(g, pm_constant(g, 1, 1, 1), shape);
        accumulate(g, y, leads, adjoint);
    }
    for (int i = 0; i < count; ++i) {
        dx[i] = x[i] != PM_NO_NODE && x[i] <= y ? adjoint[x[i]] : PM_NO_NODE;
    }
done:
    free(leads);
    free(adjoint);
}
