// Quasi-static equilibrium of bodies (beam_mesh.h, beam_element.h) under loads and in contact
// (beam_contact.h), step by step in time: Newton's method with the tangent of the step.
#ifndef PM_TRAINER_TRUTH_BEAM_SOLVE_H
#define PM_TRAINER_TRUTH_BEAM_SOLVE_H

#include "base/status.h"
#include "truth/beam_element.h"

#define PM_BEAM_MAX_ITERATIONS 30

typedef struct pm_beam pm_beam;

// Of one body, J.
typedef struct pm_beam_energy {
    double stored;
    double dissipated;   // since the start
    double work;         // of the loads since the start (trapezoidal rule along the path)
    double contact_work; // of the contact forces, likewise
} pm_beam_energy;

typedef struct pm_beam_state {
    double *q; // [nnode][3] positions, m
    // [nnode][PM_SYMMETRIC] Cauchy stress, Pa: the mean of those of the elements that meet there.
    double *sigma;
    double *contact;        // [nnode][3] forces of contact, N
    pm_beam_energy *energy; // [nbody]
    double contact_stored;  // J, in the penalty of contact
    double depth;           // m, of the deepest node behind a surface
} pm_beam_state;

typedef struct pm_beam_convergence {
    int niteration;
    double residual[PM_BEAM_MAX_ITERATIONS]; // N, norm before each iteration
} pm_beam_convergence;

// Undeformed and relaxed; `mesh` must outlive it. `contact`: its stiffness, Pa/m. PM_ENOMEM. The
// caller frees.
pm_status pm_beam_new(pm_beam **beam, const pm_beam_mesh *mesh, const pm_beam_material *material,
                      double contact);
void pm_beam_free(pm_beam *beam); // NULL is allowed
// Back to the start.
void pm_beam_reset(pm_beam *beam);

// The state now; memory of the beam's, rewritten by the next step.
const pm_beam_state *pm_beam_now(const pm_beam *beam);

// One step of h s to equilibrium under the forces f [nnode][3] (N, fixed in direction; those on
// clamped nodes have no effect). Where Newton's method does not get there, the step is halved, with
// loads linear in time. `convergence`: of the last step taken; may be NULL. PM_ENUMERIC.
pm_status pm_beam_step(pm_beam *beam, double h, const double *f, pm_beam_convergence *convergence);

#endif
