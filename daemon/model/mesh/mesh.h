// The graph of a mesh: a box of bricks that is held at one end. Its nodes carry the state of a
// body; those of the face x = 0 do not move and take no part.
#ifndef PM_MODEL_MESH_MESH_H
#define PM_MODEL_MESH_MESH_H

#include "base/arena.h"
#include "base/status.h"

// Of a node: its place in the box, each coordinate from -1 (along x the held face, which has no
// nodes) to 1, and its type: whether it lies on the free end, and on a face across y, z.
#define PM_MESH_NODE_FEATURES 6
// Edges have six directions. Of one: the vector from its source to its target, in bricks, and its
// length over the bricks' longest side.
#define PM_MESH_DIRECTIONS 6
#define PM_MESH_EDGE_FEATURES 4

// Node (i, j, k), 1 <= i <= elements[0], 0 <= j <= elements[1], 0 <= k <= elements[2], has the
// number (i - 1) + elements[0] (j + (elements[1] + 1) k). Along every edge of a brick between two
// of these nodes there are two edges of the graph, one each way.
typedef struct pm_mesh {
    double size[3]; // m, along x, y, z
    int elements[3];
    int nnode, nedge;
    const int *source, *target; // [nedge] nodes
    const int *direction;       // [nedge] of PM_MESH_DIRECTIONS: +x, -x, +y, -y, +z, -z
} pm_mesh;

#define PM_MESH_MOST_NODES 20000

// PM_ECONFIG: too many nodes, or elements or sizes that are not positive; PM_ENOMEM.
pm_status pm_mesh_make(const double size[3], const int elements[3], pm_arena *arena,
                       const pm_mesh **mesh);

// The number of the node at indices along x, y, z, which must be one of them.
static inline int pm_mesh_node(const pm_mesh *m, const int at[3]) {
    return at[0] - 1 + m->elements[0] * (at[1] + (m->elements[1] + 1) * at[2]);
}

// feature [nnode][PM_MESH_NODE_FEATURES] and [PM_MESH_DIRECTIONS][PM_MESH_EDGE_FEATURES].
void pm_mesh_node_features(const pm_mesh *mesh, double *feature);
void pm_mesh_edge_features(const pm_mesh *mesh, double *feature);

#endif
