// Computes the quasi-static equilibrium of bodies (beam_mesh.h, beam_element.h) under loads and in
// contact (beam_contact.h) at one time after another. Each step is solved by Newton's method with
// its consistent tangent.
#ifndef PM_BODIES_TRUTH_BEAM_SOLVE_H
#define PM_BODIES_TRUTH_BEAM_SOLVE_H

#include "base/status.h"
#include "bodies/truth/beam_element.h"

#define PM_BEAM_MAX_ITERATIONS 30

typedef struct pm_beam pm_beam;

// The energy balance of one body, J.
typedef struct pm_beam_energy {
    double stored;
    double dissipated;   // since the start
    double work;         // of the loads since the start, by the trapezoidal rule
    double contact_work; // of the contact forces since the start, by the trapezoidal rule
} pm_beam_energy;

typedef struct pm_beam_state {
    double *q;       // [nnode][3] m, positions
    double *sigma;   // [nnode][PM_SYMMETRIC] Pa, Cauchy stress, mean over the node's elements
    double *contact; // [nnode][3] N, contact forces
    pm_beam_energy *energy; // [nbody]
    double contact_stored;  // J, penalty energy of contact
    double depth;           // m, of the deepest node behind a surface
} pm_beam_state;

// How Newton's method converged.
typedef struct pm_beam_convergence {
    int niteration;
    double residual[PM_BEAM_MAX_ITERATIONS]; // N, norm before each iteration
} pm_beam_convergence;

// Makes undeformed, relaxed bodies. `mesh` must outlive them; `contact` is the penalty stiffness,
// Pa/m. PM_ENOMEM. The caller frees the result.
pm_status pm_beam_new(pm_beam **beam, const pm_beam_mesh *mesh, const pm_beam_material *material,
                      double contact);
void pm_beam_free(pm_beam *beam); // NULL is allowed
// Returns the bodies to the undeformed, relaxed start.
void pm_beam_reset(pm_beam *beam);

// Returns the current state. It belongs to the beam, and the next step overwrites it.
const pm_beam_state *pm_beam_now(const pm_beam *beam);

// Takes one step of h s to equilibrium under the forces f [nnode][3], N, which keep their
// direction. Forces on clamped nodes have no effect. If Newton's method does not converge, the step
// is halved, with loads linear in time. `convergence` receives the convergence of the last step
// taken; it may be NULL. PM_ENUMERIC, PM_ENOMEM.
pm_status pm_beam_step(pm_beam *beam, double h, const double *f, pm_beam_convergence *convergence);

#endif
