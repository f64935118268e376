// Makes the finite-element mesh of one body, or of several equal bodies placed in space. A body is
// a box of regular eight-node bricks, clamped on the face x = 0 of its own frame, or a single body
// of any shape from a file. The arrays hold all nodes and all elements of the first body, then
// those of the second, and so on. Every body has the same order of nodes and elements.
#ifndef PM_TRAINER_TRUTH_BEAM_MESH_H
#define PM_TRAINER_TRUTH_BEAM_MESH_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_BEAM_CORNERS 8

// The placement of a body's own frame in the global frame: the body's point x lies at
// origin + sum_d sign_d x_d e_(axis_d), with the global unit vectors e.
typedef struct pm_beam_placement {
    double origin[3]; // m
    int axis[3];      // the global axis of each axis of the body
    double sign[3];   // 1 or -1; together with `axis` a rotation
} pm_beam_placement;

typedef struct pm_beam_mesh {
    int count[3];   // elements of a box along its x, y, z; 0: the body is no box
    double size[3]; // m, of a body
    double edge;    // m, length of the first edge of the first element
    int nbody;
    pm_beam_placement *placement;       // [nbody]
    int nnode, nelement;                // of all bodies together
    double (*position)[3];              // [nnode] m, undeformed, in the global frame; x fastest
    int (*hexahedron)[PM_BEAM_CORNERS]; // [nelement] nodes, numbered as in VTK
    bool *clamped;                      // [nnode] nodes that do not move
} pm_beam_mesh;

// Makes one body whose frame is the global frame. Memory comes from the arena. PM_ENOMEM.
pm_status pm_beam_mesh_make(pm_beam_mesh *mesh, const int count[3], const double size[3],
                            pm_arena *arena);
// Makes equal bodies at placement [nbody]. Memory comes from the arena. PM_ENOMEM.
pm_status pm_beam_mesh_place(pm_beam_mesh *mesh, const int count[3], const double size[3],
                             int nbody, const pm_beam_placement *placement, pm_arena *arena);
// Makes one body of the mesh in a file (store/solid_mesh.h). Memory comes from the arena. PM_EFILE;
// PM_EDATA: the file holds no mesh, or no node or every node is clamped; PM_ENOMEM.
pm_status pm_beam_mesh_load(pm_beam_mesh *mesh, const char *path, pm_arena *arena);

// Computes the lowest and highest coordinates of an undeformed body in the global frame, m.
void pm_beam_mesh_bounds(const pm_beam_mesh *mesh, int body, double low[3], double high[3]);

// Returns the node of the first body, which is a box, at grid indices i, j, k.
static inline int pm_beam_mesh_node(const pm_beam_mesh *mesh, int i, int j, int k) {
    return i + (mesh->count[0] + 1) * (j + (mesh->count[1] + 1) * k);
}

// These functions convert the components of a vector from a body's own frame to the global frame,
// and back.
static inline void pm_beam_placement_turn(const pm_beam_placement *placement, const double *own,
                                          double *global) {
    for (int d = 0; d < 3; ++d) {
        global[placement->axis[d]] = placement->sign[d] * own[d];
    }
}
static inline void pm_beam_placement_turn_back(const pm_beam_placement *placement,
                                               const double *global, double *own) {
    for (int d = 0; d < 3; ++d) {
        own[d] = placement->sign[d] * global[placement->axis[d]];
    }
}

#endif
