// Frictionless contact of bodies at finite deflection, by a penalty. Sides that face each other
// across a gap are found once, in the undeformed mesh. Every node of either side that lies behind
// the other side's smooth surface (beam_surface.h) has the penalty energy
//     stiffness/2 area/2 depth^2
// Here `depth` is its distance from the closest point and `area` its undeformed share of its own
// side; the factor 1/2 is there because both sides count. The forces are the exact derivatives of
// this energy, so that they are equal and opposite in force and moment, and no closed path gains
// energy.
#ifndef PM_TRAINER_TRUTH_BEAM_CONTACT_H
#define PM_TRAINER_TRUTH_BEAM_CONTACT_H

#include <stdbool.h>

#include "truth/beam_surface.h"

// A node and the surface of another body that it may touch.
typedef struct pm_beam_candidate {
    int node;
    double area; // m^2
    pm_beam_surface surface;
} pm_beam_candidate;

typedef struct pm_beam_contact {
    double stiffness; // Pa/m
    int ncandidate;
    pm_beam_candidate *candidate; // [ncandidate]
} pm_beam_contact;

#define PM_BEAM_CONTACT_NODES (1 + PM_BEAM_SURFACE_NODES)

// The contact of one candidate: energy, forces and stiffness at its node and the surface's nodes.
typedef struct pm_beam_contact_force {
    int nnode;
    int node[PM_BEAM_CONTACT_NODES];
    double depth;                           // m
    double energy;                          // J
    double force[PM_BEAM_CONTACT_NODES][3]; // N
    // N/m, [3 nnode][3 nnode]
    double stiffness[3 * PM_BEAM_CONTACT_NODES * 3 * PM_BEAM_CONTACT_NODES];
} pm_beam_contact_force;

// Finds the candidates for contact between all bodies of the mesh. `stiffness` is the penalty
// stiffness per area, Pa/m. Memory from the arena. PM_ENOMEM.
pm_status pm_beam_contact_make(pm_beam_contact *contact, const pm_beam_mesh *mesh, double stiffness,
                               pm_arena *arena);

// Computes the contact of a candidate at the positions q [nnode][3], m, of all nodes; returns false
// if it does not touch the surface. With `exact` the stiffness is -d(force)/dq. Otherwise the terms
// for sliding and for the rotation of the surface are left out, which makes it positive
// semi-definite.
bool pm_beam_contact_respond(const pm_beam_contact *contact, const pm_beam_candidate *candidate,
                             const double *q, bool exact, pm_beam_contact_force *force);

#endif
