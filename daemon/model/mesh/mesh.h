// The graph of a mesh: a box of bricks that is clamped at one end. Its nodes carry the state of a
// body. The nodes of the clamped face x = 0 do not move and are left out.
#ifndef PM_MODEL_MESH_MESH_H
#define PM_MODEL_MESH_MESH_H

#include "base/arena.h"
#include "base/status.h"

// Features of a node: its three coordinates, each from -1 to 1 over the box (-1 along x is the
// clamped face, which has no nodes), and three numbers that are 1 if the node lies on the free end,
// on a face normal to y, on a face normal to z, and 0 otherwise.
#define PM_MESH_NODE_FEATURES 6
// An edge has one of six directions. Features of a direction: the unit vector from source to
// target, and the length of the edge divided by the longest side of a brick.
#define PM_MESH_DIRECTIONS 6
#define PM_MESH_EDGE_FEATURES 4

// Node (i, j, k), with 1 <= i <= elements[0], 0 <= j <= elements[1], 0 <= k <= elements[2], has the
// number (i - 1) + elements[0] (j + (elements[1] + 1) k). Two nodes that an edge of a brick joins
// are joined by two edges of the graph, one in each direction.
typedef struct pm_mesh {
    double size[3];  // m, along x, y, z
    int elements[3]; // bricks along x, y, z
    int nnode, nedge;
    const int *source, *target; // [nedge] node numbers
    const int *direction;       // [nedge] 0 to 5: +x, -x, +y, -y, +z, -z
} pm_mesh;

#define PM_MESH_MOST_NODES 20000

// Makes the mesh of a box in the arena. PM_ECONFIG: a size or a number of elements is not positive,
// or there are too many nodes. PM_ENOMEM.
pm_status pm_mesh_make(const double size[3], const int elements[3], pm_arena *arena,
                       const pm_mesh **mesh);

// Returns the number of the node with these indices along x, y, z, which must exist.
static inline int pm_mesh_node(const pm_mesh *m, const int at[3]) {
    return at[0] - 1 + m->elements[0] * (at[1] + (m->elements[1] + 1) * at[2]);
}

// Write the features of all nodes [nnode][PM_MESH_NODE_FEATURES] and of all directions
// [PM_MESH_DIRECTIONS][PM_MESH_EDGE_FEATURES].
void pm_mesh_node_features(const pm_mesh *mesh, double *feature);
void pm_mesh_edge_features(const pm_mesh *mesh, double *feature);

#endif
