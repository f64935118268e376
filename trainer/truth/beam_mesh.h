// Boxes of regular eight-node bricks, clamped at their own x = 0: one, or several equal ones placed
// in space. Bodies follow one another in nodes and elements, each numbered as if it were alone.
#ifndef PM_TRAINER_TRUTH_BEAM_MESH_H
#define PM_TRAINER_TRUTH_BEAM_MESH_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_BEAM_CORNERS 8

// Where a body's own frame lies in the world: its point x at origin + sum_d sign_d x_d e_(axis_d).
typedef struct pm_beam_placement {
    double origin[3]; // m
    int axis[3];      // of the world, for each axis of the body
    double sign[3];   // 1 or -1; with `axis` a rotation
} pm_beam_placement;

typedef struct pm_beam_mesh {
    int count[3];   // elements of a body along its x, y, z
    double size[3]; // m, of a body
    int nbody;
    pm_beam_placement *placement;       // [nbody]
    int nnode, nelement;                // in all; nbody divides both
    double (*position)[3];              // [nnode] undeformed, in the world, m; x varies fastest
    int (*hexahedron)[PM_BEAM_CORNERS]; // [nelement] nodes, in the order of VTK
} pm_beam_mesh;

// One body whose frame is the world's. Memory from the arena. PM_ENOMEM.
pm_status pm_beam_mesh_make(pm_beam_mesh *mesh, const int count[3], const double size[3],
                            pm_arena *arena);
// Bodies at placement [nbody].
pm_status pm_beam_mesh_place(pm_beam_mesh *mesh, const int count[3], const double size[3],
                             int nbody, const pm_beam_placement *placement, pm_arena *arena);

// The corners of a body's box in the world, undeformed, m.
void pm_beam_mesh_bounds(const pm_beam_mesh *mesh, int body, double low[3], double high[3]);

// The node of the first body at grid indices i, j, k.
static inline int pm_beam_mesh_node(const pm_beam_mesh *mesh, int i, int j, int k) {
    return i + (mesh->count[0] + 1) * (j + (mesh->count[1] + 1) * k);
}

static inline bool pm_beam_mesh_clamped(const pm_beam_mesh *mesh, int node) {
    return node % (mesh->count[0] + 1) == 0;
}

// A vector of a body's frame in the world's, and back.
static inline void pm_beam_placement_turn(const pm_beam_placement *placement, const double *own,
                                          double *world) {
    for (int d = 0; d < 3; ++d) {
        world[placement->axis[d]] = placement->sign[d] * own[d];
    }
}
static inline void pm_beam_placement_turn_back(const pm_beam_placement *placement,
                                               const double *world, double *own) {
    for (int d = 0; d < 3; ++d) {
        own[d] = placement->sign[d] * world[placement->axis[d]];
    }
}

#endif
