// Quasi-static equilibrium of a beam (beam_mesh.h, beam_element.h), step by step in time: Newton's
// method with the tangent of the step.
#ifndef PM_TRUTH_BEAM_SOLVE_H
#define PM_TRUTH_BEAM_SOLVE_H

#include "base/status.h"
#include "truth/beam_element.h"

#define PM_BEAM_MAX_ITERATIONS 20

typedef struct pm_beam pm_beam;

typedef struct pm_beam_state {
    double *q; // [nnode][3] positions, m
    // [nnode][PM_SYMMETRIC] Cauchy stress, Pa: the mean of those of the elements that meet there.
    double *sigma;
    double stored;     // J
    double dissipated; // J, since the start (trapezoidal rule in time)
    double work;       // J, of the loads since the start (trapezoidal rule along the path)
} pm_beam_state;

typedef struct pm_beam_convergence {
    int niteration;
    double residual[PM_BEAM_MAX_ITERATIONS]; // N, norm before each iteration
} pm_beam_convergence;

// Undeformed and relaxed; `mesh` must outlive it. PM_ENOMEM. The caller frees.
pm_status pm_beam_new(pm_beam **beam, const pm_beam_mesh *mesh, const pm_beam_material *material);
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
