// The finite-element mesh of one body, or of several equal bodies placed in space. A body is
// a box of regular eight-node bricks, clamped on the face x = 0 of its own frame, or a single body
// of any shape from a file. The arrays hold all nodes and all elements of the first body, then
// those of the second, and so on. Every body has the same order of nodes and elements.
#ifndef PM_BODIES_TRUTH_BEAM_MESH_H
#define PM_BODIES_TRUTH_BEAM_MESH_H

#include <math.h>
#include <stdbool.h>

#include "bodies/field/field.h"

#define PM_BEAM_CORNERS 8

typedef struct pm_beam_mesh {
    int count[3];   // elements of a box along its x, y, z; 0: the body is no box
    double size[3]; // m, of a body
    double edge;    // m, length of the first edge of the first element
    int nbody;
    pm_placement *placement;            // [nbody]
    int nnode, nelement;                // of all bodies together
    double (*position)[3];              // [nnode] m, undeformed, in the global frame; x fastest
    int (*hexahedron)[PM_BEAM_CORNERS]; // [nelement] nodes, numbered as in VTK
    bool *clamped;                      // [nnode] nodes that do not move
} pm_beam_mesh;

// Computes the lowest and highest coordinates of an undeformed body in the global frame, m.
static inline void pm_beam_mesh_bounds(const pm_beam_mesh *mesh, int body, double low[3],
                                       double high[3]) {
    const pm_placement *placement = &mesh->placement[body];
    double extent[3];
    pm_placement_rotate(placement, mesh->size, extent);
    for (int d = 0; d < 3; ++d) {
        low[d] = placement->origin[d] + fmin(extent[d], 0);
        high[d] = placement->origin[d] + fmax(extent[d], 0);
    }
}

// Returns the node of the first body, which is a box, at grid indices i, j, k.
static inline int pm_beam_mesh_node(const pm_beam_mesh *mesh, int i, int j, int k) {
    return i + (mesh->count[0] + 1) * (j + (mesh->count[1] + 1) * k);
}

#endif
