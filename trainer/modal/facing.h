// Where two bodies that lie apart face each other: pairs of a node of the first and the point of
// the second's surface straight across the gap, by bilinear interpolation where nodes do not meet;
// and what opens the gap there, linear in the displacements of both.
//
// Sliding is small: the pairs stay as they are in the undeformed bodies, but a point that has slid
// meets a surface that slopes. With n the normal of the first, t_u and t_v tangents to it, and one
// number per pair,
//     opening = g + u slope_u + v slope_v
//     g = gap + n.(u_2 - u_1)      u = t_u.(u_1 - u_2)      slope_u = d(n.u)/dt_u    (v likewise)
// which is second order in the displacements: the force that the opening gives is normal to the
// sloping surface and acts where the point has slid to. Along a tangent the slope is that of the
// body whose side is longer there: the other one's edge moves on it; of equals it is the mean.
#ifndef PM_MODAL_FACING_H
#define PM_MODAL_FACING_H

#include "base/arena.h"
#include "base/status.h"

// What is known of a pair; the order of groups in pm_facing_measure.
typedef enum pm_facing_group {
    PM_FACING_GAP,
    PM_FACING_SLID_U,
    PM_FACING_SLID_V,
    PM_FACING_SLOPE_U,
    PM_FACING_SLOPE_V
} pm_facing_group;
#define PM_FACING_GROUPS 5

// A body as it lies, undeformed.
typedef struct pm_placed {
    const char *name;
    int nnode, nelement;
    const double *position;   // [nnode][3] m, in its own frame
    const double *hexahedron; // [nelement][8] nodes, as in VTK
    double origin[3];         // of its frame in the world, m
    double axis[3][3];        // its axes in the world, orthonormal
} pm_placed;

// Seven quadrangles that meet at a node have 15.
#define PM_FACING_MOST_NODES 16

// A point of a body's surface, its value and its slopes as sums over nodes.
typedef struct pm_facing_point {
    int nnode;
    int node[PM_FACING_MOST_NODES];
    double value[PM_FACING_MOST_NODES];
    double slope[2][PM_FACING_MOST_NODES]; // 1/m, along t_u and t_v
    double share[2];                       // of its slope in that of the pair: 0, 1/2 or 1
} pm_facing_point;

typedef struct pm_facing_pair {
    double gap;               // m, undeformed
    double normal[3];         // of the first body, in the world
    double tangent[2][3];     // in the world
    pm_facing_point point[2]; // of the first and the second
} pm_facing_pair;

typedef struct pm_facing {
    int npair;
    pm_facing_pair *pair; // [npair]
} pm_facing;

// Pairs of two bodies; none if they do not face each other. Memory from the arena. PM_EDATA (a body
// without a mesh, or one where more faces meet at a node than a point has room for), PM_ENOMEM.
pm_status pm_facing_find(pm_facing *facing, const pm_placed *first, const pm_placed *second,
                         pm_arena *arena);

// Adds what displacements u [nnode][3] of one end's body, in its own frame, contribute to
// value [PM_FACING_GROUPS][npair]. The undeformed gap is not in it.
void pm_facing_measure(const pm_facing *facing, int end, const pm_placed *body, const double *u,
                       double *value);

// The adjoint: adds to forces f [nnode][3] of one end's body, in its own frame, N, what gives the
// power -effort.value for every u: the forces that an energy with the derivatives
// effort [PM_FACING_GROUPS][npair] by the groups exerts on the nodes.
void pm_facing_add_forces(const pm_facing *facing, int end, const pm_placed *body,
                          const double *effort, double *f);

#endif
