// Small matrices times the rows of nodes, expressed as gathers, row products and scatters.
#include "model/mesh/nodal.h"

#include <stdlib.h>

#include "graph/node.h"
#include "model/spec.h"

static int components_of(pm_nodal_fields f) {
    int sum = 0;
    for (int i = 0; i < f.count; ++i) {
        sum += f.components[i];
    }
    return sum;
}

// Convert a row [1][n] of all fields to one row per node [nnode][components], and back.
static pm_node to_nodes(pm_graph *g, pm_nodal_fields f, pm_node x) {
    pm_node part[2 * PM_MAX_GROUPS];
    int first = 0;
    for (int i = 0; i < f.count; ++i) {
        const int size = f.nnode * f.components[i];
        part[i] = pm_reshape(g, pm_slice(g, x, first, size), f.nnode, f.components[i]);
        first += size;
    }
    return pm_concat(g, f.count, part);
}

static pm_node from_nodes(pm_graph *g, pm_nodal_fields f, pm_node nodes) {
    pm_node part[2 * PM_MAX_GROUPS];
    int first = 0;
    for (int i = 0; i < f.count; ++i) {
        part[i] =
            pm_reshape(g, pm_slice(g, nodes, first, f.components[i]), 1, f.nnode * f.components[i]);
        first += f.components[i];
    }
    return pm_concat(g, f.count, part);
}

// Allocates an index [count]. NULL: out of memory, which the graph remembers.
static int *new_index(pm_graph *g, int count) {
    int *index = malloc((size_t)count * sizeof *index);
    if (index == NULL) {
        pm_graph_exhaust(g);
    }
    return index;
}

// Returns the node of each row of all nodes' matrices, [nnode * rows]. The caller frees it. NULL:
// out of memory.
static int *nodes_of_rows(pm_graph *g, int nnode, int rows) {
    int *index = new_index(g, nnode * rows);
    for (int r = 0; index != NULL && r < nnode * rows; ++r) {
        index[r] = r / rows;
    }
    return index;
}

// Returns each node's matrix [rows][rows] transposed, all of them [nnode * rows][rows].
static pm_node transposed(pm_graph *g, int nnode, int rows, pm_node matrix) {
    const int count = nnode * rows * rows;
    int *index = new_index(g, count);
    if (index == NULL) {
        return matrix;
    }
    for (int i = 0; i < count; ++i) {
        const int row = i / rows;
        index[i] = (row / rows * rows + i % rows) * rows + row % rows;
    }
    const pm_node entries = pm_gather_rows(g, pm_reshape(g, matrix, count, 1), count, index);
    free(index);
    return pm_reshape(g, entries, nnode * rows, rows);
}

// Returns each node's matrix [nnode * rows][columns] times the node's x [nnode][columns].
static pm_node times(pm_graph *g, int nnode, int rows, const int *node, pm_node matrix, pm_node x) {
    const pm_node of_row = pm_gather_rows(g, x, nnode * rows, node);
    return pm_reshape(g, pm_dot(g, matrix, of_row), nnode, rows);
}

// Returns each node's transposed matrix times the node's x [nnode][rows].
static pm_node times_transposed(pm_graph *g, int nnode, int rows, const int *node, pm_node matrix,
                                pm_node x) {
    const pm_node weighted = pm_mul(g, matrix, pm_reshape(g, x, nnode * rows, 1));
    return pm_scatter_add_rows(g, weighted, nnode, nnode * rows, node);
}

pm_node pm_nodal_skew(pm_graph *g, pm_nodal_fields fields, pm_node matrix, pm_node x) {
    const int rows = components_of(fields), nnode = fields.nnode;
    int *node = nodes_of_rows(g, nnode, rows);
    if (node == NULL) {
        return x;
    }
    // As in operator.c, C - C^T is formed before it is multiplied by x. In C x - C^T x the terms of
    // the diagonal would cancel only up to rounding.
    const pm_node c = pm_reshape(g, matrix, nnode * rows, rows);
    const pm_node skew = pm_sub(g, c, transposed(g, nnode, rows, matrix));
    const pm_node rate = times(g, nnode, rows, node, skew, to_nodes(g, fields, x));
    free(node);
    return from_nodes(g, fields, rate);
}

pm_node pm_nodal_square(pm_graph *g, pm_nodal_fields fields, int columns, pm_node matrix,
                        pm_node x) {
    const int rows = components_of(fields), nnode = fields.nnode;
    int *node = nodes_of_rows(g, nnode, rows);
    if (node == NULL) {
        return x;
    }
    const pm_node factor = pm_reshape(g, matrix, nnode * rows, columns);
    const pm_node along = times_transposed(g, nnode, rows, node, factor, to_nodes(g, fields, x));
    const pm_node rate = times(g, nnode, rows, node, factor, along);
    free(node);
    return from_nodes(g, fields, rate);
}
