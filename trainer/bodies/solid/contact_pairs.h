// Contact pairs of two bodies that lie apart. A pair is a node on the surface of the first body and
// the point of the second body's surface straight across the gap, found in the undeformed bodies.
// The point is interpolated bilinearly between the nodes of its face.
//
// Sliding is assumed to be small: the pairs stay the same while the bodies deform. The slope of the
// surface changes the opening of a pair that has slid. Let n be the normal of the first body, t_u
// and t_v tangents to it, and u_1, u_2 the displacements of both points. The distance of a pair is
// then
//     opening = g + u slope_u + v slope_v
//     g = gap + n.(u_2 - u_1)      u = t_u.(u_1 - u_2)      slope_u = d(n.u)/dt_u    (v likewise)
// with the five quantities g, u, v, slope_u and slope_v linear in the displacements. To second
// order in the displacements, the force that follows from the opening is normal to the sloping
// surface and acts where the point has slid to. Along a tangent the slope is taken from the body
// whose side is longer there, because the edge of the other body moves along it; for sides of equal
// length it is the mean of both.
#ifndef PM_BODIES_SOLID_CONTACT_PAIRS_H
#define PM_BODIES_SOLID_CONTACT_PAIRS_H

#include "base/arena.h"
#include "base/status.h"
#include "bodies/field/field.h"

// The five quantities of a pair. Arrays of them are [PM_CONTACT_GROUPS][npair].
typedef enum pm_contact_group {
    PM_CONTACT_GAP,     // g, m
    PM_CONTACT_SLID_U,  // u, m
    PM_CONTACT_SLID_V,  // v, m
    PM_CONTACT_SLOPE_U, // slope_u
    PM_CONTACT_SLOPE_V  // slope_v
} pm_contact_group;
#define PM_CONTACT_GROUPS 5

// An undeformed body with its placement in space. The caller owns the arrays.
typedef struct pm_placed_body {
    const char *name;
    int nnode, nelement;
    const double *position;   // [nnode][3] m, in the body's own frame
    const double *hexahedron; // [nelement][8] nodes, numbered as in VTK
    pm_placement placement;   // of its own frame in the global frame
} pm_placed_body;

// The most nodes of a contact point. If seven quadrangles meet at a node, they have 15 nodes in
// all.
#define PM_CONTACT_MOST_NODES 16

// A point of a body's surface: its displacement and the slopes of its surface are weighted sums
// over nodes.
typedef struct pm_contact_point {
    int nnode;
    int node[PM_CONTACT_MOST_NODES];
    double value[PM_CONTACT_MOST_NODES];    // weights of the displacement
    double slope[2][PM_CONTACT_MOST_NODES]; // 1/m, weights of its derivatives along t_u and t_v
    double share[2]; // weight of this body's slope in the slope of the pair, along t_u and t_v
} pm_contact_point;

typedef struct pm_contact_pair {
    double gap;                // m, undeformed
    double normal[3];          // unit normal of the first body, outwards, in the global frame
    double tangent[2][3];      // unit tangents t_u and t_v, in the global frame
    pm_contact_point point[2]; // of the first and the second body
} pm_contact_pair;

typedef struct pm_contact_pairs {
    int npair;
    pm_contact_pair *pair; // [npair]
} pm_contact_pairs;

// Finds the pairs of two bodies; there are none if no sides face each other. Memory from the arena.
// PM_EDATA (a body without a mesh, or more faces that meet at a point than a pm_contact_point has
// room for), PM_ENOMEM.
pm_status pm_contact_pairs_find(pm_contact_pairs *pairs, const pm_placed_body *first,
                                const pm_placed_body *second, pm_arena *arena);

// Adds the contribution of the displacements u [nnode][3], m, in the own frame of one body (`end`
// 0: the first, 1: the second) to the quantities value [PM_CONTACT_GROUPS][npair]. The undeformed
// gap is not included.
void pm_contact_pairs_measure(const pm_contact_pairs *pairs, int end, const pm_placed_body *body,
                              const double *u, double *value);

// Adds to f [nnode][3], in N and in the frame of `body`, the forces on the nodes of `body` that
// follow from an energy whose derivatives with respect to the quantities are effort
// [PM_CONTACT_GROUPS][npair]. The function is the adjoint of pm_contact_pairs_measure: for every u
// the added forces satisfy f.u = -effort.value.
void pm_contact_pairs_add_forces(const pm_contact_pairs *pairs, int end, const pm_placed_body *body,
                                 const double *effort, double *f);

#endif
