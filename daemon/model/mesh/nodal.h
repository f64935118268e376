// Operators on a mesh that consist of one small matrix per node: L = C - C^T or M = G G^T at each
// node. C - C^T moves power between the components of one node and leaves x . rate = 0; G G^T gives
// x . rate >= 0 at every node.
#ifndef PM_MODEL_MESH_NODAL_H
#define PM_MODEL_MESH_NODAL_H

#include "graph/graph.h"

// The fields on which an operator acts. A row [1][n] holds them one after the other, each field
// with its components node by node. Borrowed.
typedef struct pm_nodal_fields {
    int nnode, count;
    const int *components; // [count] per node
} pm_nodal_fields;

// Return (C - C^T) x and G G^T x for a row x [1][n] of all fields. `matrix` [nnode][rows * columns]
// holds C [rows][rows] or G [rows][columns] of each node, where rows is the sum of the components
// of all fields.
pm_node pm_nodal_skew(pm_graph *g, pm_nodal_fields fields, pm_node matrix, pm_node x);
pm_node pm_nodal_square(pm_graph *g, pm_nodal_fields fields, int columns, pm_node matrix,
                        pm_node x);

#endif
