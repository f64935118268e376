// Operators made of one small matrix per node of a mesh: L and M of every node by themselves. What
// x . rate counts, such as power, (C - C^T) x moves between components of one node; G G^T x makes
// some of it at every node, never less than 0.
#ifndef PM_MODEL_MESH_NODAL_H
#define PM_MODEL_MESH_NODAL_H

#include "graph/graph.h"

// The fields an operator acts on, side by side in a row [1][n], each with its components node by
// node.
typedef struct pm_nodal_fields {
    int nnode, count;
    const int *components; // [count] of each per node
} pm_nodal_fields;

// (C - C^T) x, or G G^T x, for a row x [1][n] of all fields; `matrix` [nnode][rows * columns] holds
// C [rows][rows] or G [rows][columns] of each node, rows being the components of all fields.
pm_node pm_nodal_skew(pm_graph *g, pm_nodal_fields fields, pm_node matrix, pm_node x);
pm_node pm_nodal_square(pm_graph *g, pm_nodal_fields fields, int columns, pm_node matrix,
                        pm_node x);

#endif
