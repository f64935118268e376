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
#ifndef PM_TRAINER_BODY_CONTACT_PAIRS_H
#define PM_TRAINER_BODY_CONTACT_PAIRS_H

#include "base/arena.h"
#include "base/status.h"

// What is known of a pair; the order of groups in pm_contact_pairs_measure.
typedef enum pm_contact_group {
    PM_CONTACT_GAP,
    PM_CONTACT_SLID_U,
    PM_CONTACT_SLID_V,
    PM_CONTACT_SLOPE_U,
    PM_CONTACT_SLOPE_V
} pm_contact_group;
#define PM_CONTACT_GROUPS 5

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
#define PM_CONTACT_MOST_NODES 16

// A point of a body's surface, its value and its slopes as sums over nodes.
typedef struct pm_contact_point {
    int nnode;
    int node[PM_CONTACT_MOST_NODES];
    double value[PM_CONTACT_MOST_NODES];
    double slope[2][PM_CONTACT_MOST_NODES]; // 1/m, along t_u and t_v
    double share[2];                        // of its slope in that of the pair: 0, 1/2 or 1
} pm_contact_point;

typedef struct pm_contact_pair {
    double gap;                // m, undeformed
    double normal[3];          // of the first body, in the world
    double tangent[2][3];      // in the world
    pm_contact_point point[2]; // of the first and the second
} pm_contact_pair;

typedef struct pm_contact_pairs {
    int npair;
    pm_contact_pair *pair; // [npair]
} pm_contact_pairs;

// Pairs of two bodies; none if they do not face each other. Memory from the arena. PM_EDATA (a body
// without a mesh, or one where more faces meet at a node than a point has room for), PM_ENOMEM.
pm_status pm_contact_pairs_find(pm_contact_pairs *facing, const pm_placed *first,
                                const pm_placed *second, pm_arena *arena);

// Adds what displacements u [nnode][3] of one end's body, in its own frame, contribute to
// value [PM_CONTACT_GROUPS][npair]. The undeformed gap is not in it.
void pm_contact_pairs_measure(const pm_contact_pairs *facing, int end, const pm_placed *body,
                              const double *u, double *value);

// The adjoint: adds to forces f [nnode][3] of one end's body, in its own frame, N, what gives the
// power -effort.value for every u: the forces that an energy with the derivatives
// effort [PM_CONTACT_GROUPS][npair] by the groups exerts on the nodes.
void pm_contact_pairs_add_forces(const pm_contact_pairs *facing, int end, const pm_placed *body,
                                 const double *effort, double *f);

#endif
