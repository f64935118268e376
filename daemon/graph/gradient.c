// Reverse accumulation: walks from the result to the leaves and adds up adjoints. It builds nodes
// only for operands that depend on a node whose derivative is wanted.
#include <assert.h>
#include <stdlib.h>

#include "graph/node.h"

// A walk over the nodes from `first`, the first one whose derivative is wanted, to `last`. Earlier
// nodes cannot depend on a wanted one. Arrays are indexed from `first`.
typedef struct reverse_walk {
    pm_node first, last;
    bool *leads;      // whether the node is wanted or depends on a wanted node
    pm_node *adjoint; // d last / d node; PM_NO_NODE: zero
} reverse_walk;

static void mark_leading(const pm_graph *g, reverse_walk *w, int count, const pm_node *wanted) {
    for (int i = 0; i < count; ++i) {
        if (wanted[i] != PM_NO_NODE && wanted[i] <= w->last) {
            w->leads[wanted[i] - w->first] = true;
        }
    }
    for (pm_node x = w->first; x <= w->last; ++x) {
        const pm_graph_node *node = pm_graph_node_at(g, x);
        bool leads = w->leads[x - w->first];
        for (int i = 0; i < node->noperand && !leads; ++i) {
            leads = node->operand[i] >= w->first && w->leads[node->operand[i] - w->first];
        }
        w->leads[x - w->first] = leads;
    }
}

static void accumulate(pm_graph *g, reverse_walk *w) {
    for (pm_node x = w->last; x >= w->first; --x) {
        const pm_node adjoint = w->adjoint[x - w->first];
        if (adjoint == PM_NO_NODE || !w->leads[x - w->first]) {
            continue;
        }
        const pm_op op = pm_graph_node_at(g, x)->op;
        const int noperand = pm_graph_node_at(g, x)->noperand;
        for (int i = 0; i < noperand; ++i) {
            const pm_node operand = pm_graph_node_at(g, x)->operand[i];
            if (operand >= w->first && w->leads[operand - w->first]) {
                const pm_node term = pm_operations[op].adjoint(g, x, adjoint, i);
                pm_node *sum = &w->adjoint[operand - w->first];
                *sum = pm_add_or(g, *sum, term);
            }
        }
    }
}

static pm_node first_of(int count, const pm_node *x, pm_node last) {
    pm_node first = last;
    for (int i = 0; i < count; ++i) {
        first = x[i] != PM_NO_NODE && x[i] < first ? x[i] : first;
    }
    return first;
}

void pm_gradient(pm_graph *g, pm_node y, pm_node seed, int count, const pm_node *x, pm_node *dx) {
    for (int i = 0; i < count; ++i) {
        dx[i] = PM_NO_NODE;
    }
    if (y == PM_NO_NODE || pm_graph_exhausted(g)) {
        return;
    }
    reverse_walk w = {.first = first_of(count, x, y), .last = y};
    const size_t size = (size_t)(w.last - w.first) + 1;
    w.leads = calloc(size, sizeof *w.leads);
    w.adjoint = malloc(size * sizeof *w.adjoint);
    if (w.leads == NULL || w.adjoint == NULL) {
        pm_graph_exhaust(g);
        goto done;
    }
    for (size_t i = 0; i < size; ++i) {
        w.adjoint[i] = PM_NO_NODE;
    }
    mark_leading(g, &w, count, x);
    if (w.leads[y - w.first]) {
        const pm_shape shape = pm_graph_shape(g, y);
        w.adjoint[y - w.first] =
            seed != PM_NO_NODE ? seed : pm_broadcast_to(g, pm_constant(g, 1, 1, 1), shape);
        accumulate(g, &w);
    }
    for (int i = 0; i < count; ++i) {
        dx[i] = x[i] != PM_NO_NODE && x[i] <= y ? w.adjoint[x[i] - w.first] : PM_NO_NODE;
    }
done:
    free(w.leads);
    free(w.adjoint);
}
