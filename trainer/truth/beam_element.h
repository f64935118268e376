// The eight-node brick with one pressure (Q1/P0, mean dilatation: Simo, Taylor, Pister, Comput.
// Methods Appl. Mech. Eng. 51, 1985): the energy of volume is taken of the element's ratio of
// volumes theta, as (theta - 1)^2 / D1, so that nearly incompressible material does not lock.
#ifndef PM_TRAINER_TRUTH_BEAM_ELEMENT_H
#define PM_TRAINER_TRUTH_BEAM_ELEMENT_H

#include <stdbool.h>

#include "truth/beam_material.h"
#include "truth/beam_mesh.h"

#define PM_BEAM_POINTS 8 // of Gauss
#define PM_BEAM_FREEDOMS 24

typedef struct pm_beam_element {
    double gradient[PM_BEAM_POINTS][PM_BEAM_CORNERS][3]; // of the shape functions, undeformed, 1/m
    double weight[PM_BEAM_POINTS];                       // m^3
    double volume;                                       // their sum
} pm_beam_element;

typedef struct pm_beam_element_response {
    double force[PM_BEAM_FREEDOMS];                       // N, dE/dq at the corners
    double stiffness[PM_BEAM_FREEDOMS][PM_BEAM_FREEDOMS]; // N/m; upper triangle alone
    double energy;                                        // J, stored
    double dissipated;                                    // J, in the step
    double stress[PM_SYMMETRIC];                          // Cauchy, Pa, mean over the points
} pm_beam_element_response;

// x [PM_BEAM_CORNERS][3]: the corners' undeformed positions, in the order of VTK.
void pm_beam_element_init(pm_beam_element *element, const double *x);

// The response to the corners' positions q [PM_BEAM_CORNERS][3], h s after `before`
// [PM_BEAM_POINTS]; then `after` is what the points remember. False if a point is turned inside
// out.
bool pm_beam_element_respond(const pm_beam_element *element, const pm_beam_material *material,
                             double h, const double *q, const pm_beam_memory *before,
                             pm_beam_memory *after, pm_beam_element_response *response);

#endif
