// The surface of a body on a mesh of hexahedra: the faces that belong to one element only.
#ifndef PM_BODIES_SOLID_SURFACE_H
#define PM_BODIES_SOLID_SURFACE_H

#include "base/arena.h"
#include "base/status.h"

// A quadrangle; seen from outside its nodes run counterclockwise.
typedef struct pm_surface_face {
    int node[4];
    int sorted[4]; // the same nodes in ascending order, which identify the face
} pm_surface_face;

typedef struct pm_surface {
    int nface;
    pm_surface_face *face; // [nface], ordered by `sorted`
} pm_surface;

// Finds the surface of `nelement` > 0 hexahedra [nelement][8], whose nodes are numbered as in VTK.
// Memory from the arena. PM_ENOMEM.
pm_status pm_surface_find(pm_surface *surface, int nelement, const double *hexahedron,
                          pm_arena *arena);

#endif
