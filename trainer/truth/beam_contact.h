// Frictionless contact of bodies at finite deflection. Sides that face each other across a gap are
// found once, from the undeformed mesh; then each node of either is held off the other's smooth
// surface (beam_surface.h) by the penalty energy
//     stiffness/2 area/2 depth^2
// where it has come to lie behind it: `depth` is its distance from the closest point, `area` its
// share of its side, undeformed, and both sides count half. Forces are this energy's exact
// derivatives, hence equal and opposite in force and moment, and no path can gain energy.
#ifndef PM_TRAINER_TRUTH_BEAM_CONTACT_H
#define PM_TRAINER_TRUTH_BEAM_CONTACT_H

#include <stdbool.h>

#include "truth/beam_surface.h"

typedef struct pm_beam_candidate {
    int node;
    double area;             // m^2
    pm_beam_surface surface; // of the other body
} pm_beam_candidate;

typedef struct pm_beam_contact {
    double stiffness; // Pa/m
    int ncandidate;
    pm_beam_candidate *candidate; // [ncandidate]
} pm_beam_contact;

#define PM_BEAM_TOUCH_NODES (1 + PM_BEAM_SURFACE_NODES)

// A node behind a surface.
typedef struct pm_beam_contact_force {
    int nnode;
    int node[PM_BEAM_TOUCH_NODES];
    double depth;                                                        // m
    double energy;                                                       // J
    double force[PM_BEAM_TOUCH_NODES][3];                                // N, on the nodes
    double stiffness[3 * PM_BEAM_TOUCH_NODES * 3 * PM_BEAM_TOUCH_NODES]; // N/m, [3 nnode][3 nnode]
} pm_beam_contact_force;

// Memory from the arena. PM_ENOMEM.
pm_status pm_beam_contact_make(pm_beam_contact *contact, const pm_beam_mesh *mesh, double stiffness,
                               pm_arena *arena);

// What a candidate does at the positions q [nnode][3]. The stiffness is -d(force)/dq if `exact`,
// and otherwise what of it is never negative: without sliding and without the surface's turning.
// False: it does not touch.
bool pm_beam_contact_respond(const pm_beam_contact *contact, const pm_beam_candidate *candidate,
                             const double *q, bool exact, pm_beam_contact_force *touch);

#endif
