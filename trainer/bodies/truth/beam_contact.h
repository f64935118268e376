// Frictionless contact of bodies at finite deflection, by a penalty. Sides that face each other
// across a gap are found once, in the undeformed mesh. Every node of either side that lies behind
// the other side's smooth surface has the penalty energy
//     stiffness/2 area/2 depth^2
// Here `depth` is its distance from the closest point and `area` its undeformed share of its own
// side; the factor 1/2 is there because both sides count. The forces are the exact derivatives of
// this energy, so that they are equal and opposite in force and moment, and no closed path gains
// energy.
#ifndef PM_BODIES_TRUTH_BEAM_CONTACT_H
#define PM_BODIES_TRUTH_BEAM_CONTACT_H

#include <stdbool.h>

#include "bodies/truth/beam_mesh.h"

// A smooth surface through the nodes on one side of a body. It consists of piecewise cubics
// (Catmull, Rom, 1974), is straight beyond the outermost nodes, and is once continuously
// differentiable. Beyond its edges it bends into the body along parabolas, so that a node that
// slides over an edge does not gain or lose contact abruptly. Every point is a sum over nodes with
// weights that depend on the surface coordinates u and v alone and sum to 1. Flat sides therefore
// stay flat, and at the place of a node its own weight is 1.
typedef struct pm_beam_surface {
    int first;      // node at u = v = 0
    int stride[3];  // between neighbouring nodes along u (the body's x), along v, and inwards
    int count[2];   // elements along u and v
    double step[3]; // m, undeformed distance of nodes along u, along v, and inwards
    double side;    // 1 or -1, such that side dx/du x dx/dv points out of the body
} pm_beam_surface;

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

#define PM_BEAM_CONTACT_NODES 33 // 1 and those of the surface

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
