// The surface of a body of any shape: the faces that belong to one element alone.
#ifndef PM_TRAINER_TRUTH_BEAM_SKIN_H
#define PM_TRAINER_TRUTH_BEAM_SKIN_H

#include "base/rng.h"
#include "truth/beam_mesh.h"

typedef struct pm_beam_face {
    int node[4];
    double centre[3];  // m, undeformed
    double outward[3]; // unit normal
    double area;       // m^2
    double distance;   // m, of the centre from the nearest clamped node
} pm_beam_face;

typedef struct pm_beam_skin {
    int nface, nnode;
    pm_beam_face *face;   // [nface]
    int *node;            // [nnode] nodes of these faces
    int *first, *face_at; // [nnode + 1], [4 nface] the faces of each of these nodes
    double farthest;      // m, the largest distance of a face
} pm_beam_skin;

// Finds the surface of a single body. Memory comes from the arena. PM_ENOMEM.
pm_status pm_beam_skin_make(pm_beam_skin *skin, const pm_beam_mesh *mesh, pm_arena *arena);

// Draws a face, each with a probability proportional to its area, among those whose distance is at
// least the share `nearest` of the largest one.
const pm_beam_face *pm_beam_skin_draw(const pm_beam_skin *skin, double nearest, pm_rng *rng);

// Returns true if a face of node number i of the surface has a normal within 45 degrees of
// `outward`.
bool pm_beam_skin_faces(const pm_beam_skin *skin, int i, const double *outward);

#endif
