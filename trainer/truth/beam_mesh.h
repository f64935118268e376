// A box of regular eight-node bricks, clamped at x = 0.
#ifndef PM_TRUTH_BEAM_MESH_H
#define PM_TRUTH_BEAM_MESH_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_BEAM_CORNERS 8

typedef struct pm_beam_mesh {
    int count[3];   // elements along x, y, z
    double size[3]; // m
    int nnode, nelement;
    double (*position)[3];              // [nnode] undeformed, m; x varies fastest
    int (*hexahedron)[PM_BEAM_CORNERS]; // [nelement] nodes, in the order of VTK
} pm_beam_mesh;

// Memory from the arena. PM_ENOMEM.
pm_status pm_beam_mesh_make(pm_beam_mesh *mesh, const int count[3], const double size[3],
                            pm_arena *arena);

// The node at grid indices i, j, k.
static inline int pm_beam_mesh_node(const pm_beam_mesh *mesh, int i, int j, int k) {
    return i + (mesh->count[0] + 1) * (j + (mesh->count[1] + 1) * k);
}

static inline bool pm_beam_mesh_clamped(const pm_beam_mesh *mesh, int node) {
    return node % (mesh->count[0] + 1) == 0;
}

#endif
