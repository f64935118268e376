// A gap between bodies of which at least one is a solid (solid_dynamics.h), under an implicit
// integrator. A solid has no inertia: it answers a force of contact at once, and the stiffness of
// the gap times the compliance of the body may be 10^4 and more, so that a fixed-point iteration
// between them diverges. The gap therefore learns from their answers how far the bodies give way.
//
// State and force. The gap's state holds the travel x of the bodies, on which its energy E depends,
// and an entropy s that takes up heat. In a substep from x0 to x1 it shows the co-energy
//     e = a e0 + b e1  with  e0 = dE/dx(x0), e1 = dE/dx(x1),
// with which ports book their power, and as `response` the co-energy e1, because a solid is in
// balance with the force at the end of the substep. (Once the bodies agree with the gap, e1 keeps
// the value that they have answered.) The gap takes in e.(x1 - x0); what it does not store becomes
// heat. a and b are 1/2 unless the heat would be negative, as it may be where pairs open. They are
// then such that the heat is zero: with a + b = 1 if b can be at most 1, as always if E is convex
// along the motion, and else, as where points slide along a side that turns, the numbers closest to
// 1/2 in the sense of least squares. The laws hold for any x1, and the forces on both bodies stay
// equal and opposite, since they are so in e0 and in e1.
//
// Iteration. The answer of the bodies to the forces e1 is the travel y(e1). A substep is solved
// when y(dE/dx(x)) = x. Answers of the past give pairs of changes of e1 and y, from which a
// limited-memory BFGS matrix C approximates -dy/de1; C is symmetric and positive definite as the
// compliance of bodies is. The next state x solves
//     x - y + C (dE/dx(x) - e1) = 0
// with the exact, not differentiable dE/dx, by Newton's method with GMRES (Nocedal and Wright,
// Numerical Optimization, 2006, algorithm 7.4; Saad and Schultz, SIAM J. Sci. Stat. Comput. 7,
// 1986). Which pairs of points touch is found in the gap, without asking the bodies.
#ifndef PM_SIM_CONTACT_GAP_H
#define PM_SIM_CONTACT_GAP_H

#include "base/serializer.h"
#include "graph/program.h"
#include "scene/system.h"

// The largest number of pairs that the gap remembers.
#define PM_CONTACT_GAP_PAIRS 40

typedef struct pm_contact_gap {
    int nz, s;           // components of the state; that of the entropy
    int n, *component;   // [n] travel: components on which ports act
    double temperature;  // K
    pm_program *program; // borrowed: computes energy and gradient from z
    double *z;           // [nz] input of the program
    // [1], [nz] outputs of the program: energy and its gradient.
    const double *result, *gradient;
    double E, S;                // J, J/K at the exposed state
    double *dE, *dS, *response; // [nz] shown
    double *start, *e0;         // [nz], [n] state and co-energies at the start of the substep
    double stored0, heat;       // J, stored at the start of the substep, and heat since then
    int round;                  // of the substep
    bool heard;                 // `last_e` and `last_answer` are of this substep
    bool settled;               // the bodies agree with the forces e, which no longer change
    // [n] forces that the gap shows at the end of the substep, the answer to them, and those
    // before.
    double *e, *answer, *last_e, *last_answer;
    double *change_e, *change_y; // [PM_CONTACT_GAP_PAIRS][n], oldest first
    int count;
    double change; // of the last round in which the state moved
    double *work;  // of the solution
} pm_contact_gap;

// Opens the gap. The arrays lie in the arena. PM_ECONFIG: the subsystem has no entropy to take up
// heat, or irreversible operators. PM_ENOMEM.
pm_status pm_contact_gap_open(pm_contact_gap *gap, pm_arena *arena, const pm_system *system,
                              int id);
// Sets the program whose input is z [nz] and whose outputs are the energy and its gradient. All are
// borrowed.
void pm_contact_gap_set_program(pm_contact_gap *gap, pm_program *program, double *z,
                                const double *result, const double *gradient);

// Begins a substep at z [nz].
void pm_contact_gap_begin(pm_contact_gap *gap, const double *z);
// Computes E, S, dE, dS and response at z [nz].
void pm_contact_gap_expose(pm_contact_gap *gap, const double *z);
// Computes the next state `next` [nz] from the present one, z, for which pm_contact_gap_expose was
// called, and from `reached` [nz], the state that follows from the present rates of the bodies.
void pm_contact_gap_next(pm_contact_gap *gap, const double *z, const double *reached, double *next);
// Returns the change of the iterate that decides whether the iteration has converged, where that of
// the state is `change`. Bodies answer in every second round; in between the gap waits.
double pm_contact_gap_change(pm_contact_gap *gap, double change);

// Puts what the next step needs besides the state into the serializer.
void pm_contact_gap_record(pm_contact_gap *gap, pm_serializer *serializer);

#endif
