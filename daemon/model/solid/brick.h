// The kinematics of an element with eight nodes. The messages of the network travel between an
// element and its nodes: the positions of the nodes become the deformation gradients at eight
// points of the element, and its stresses there become forces on the nodes. This is all that a mesh
// has to supply, so that a learned material serves every mesh of such elements (Hughes, The Finite
// Element Method, 2000, section 3.3).
#ifndef PM_MODEL_SOLID_BRICK_H
#define PM_MODEL_SOLID_BRICK_H

#include <stdbool.h>

#include "store/solid_mesh.h"

#define PM_BRICK_POINTS 8

typedef struct pm_brick {
    double gradient[PM_BRICK_NODES][3][PM_BRICK_POINTS]; // 1/m, of the shape functions, undeformed
    double weight[PM_BRICK_POINTS];                      // m^3, of the points in integrals
    double volume;                                       // m^3, undeformed
} pm_brick;

// Computes the brick with the undeformed nodes x [PM_BRICK_NODES][3], m, numbered as in VTK.
// Returns false if it has no positive volume at one of its points.
bool pm_brick_make(pm_brick *brick, const double *x);

// Computes the deformation gradients F [PM_BRICK_POINTS][9] from the displacements u
// [PM_BRICK_NODES][3].
void pm_brick_deform(const pm_brick *brick, const double *u, double F[PM_BRICK_POINTS][9]);

#endif
