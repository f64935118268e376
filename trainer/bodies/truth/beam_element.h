// The eight-node brick with one pressure (Q1/P0, mean dilatation: Simo, Taylor, Pister, Comput.
// Methods Appl. Mech. Eng. 51, 1985). With the ratio theta of the element's deformed to its
// undeformed volume, the energy of volume is (theta - 1)^2 / D1 per undeformed volume. It depends
// on the element as a whole, so that nearly incompressible material does not lock.
#ifndef PM_BODIES_TRUTH_BEAM_ELEMENT_H
#define PM_BODIES_TRUTH_BEAM_ELEMENT_H

#include <stdbool.h>

#include "bodies/truth/beam_material.h"
#include "bodies/truth/beam_mesh.h"

#define PM_BEAM_POINTS 8 // Gauss points
#define PM_BEAM_FREEDOMS 24

typedef struct pm_beam_element {
    double gradient[PM_BEAM_POINTS][PM_BEAM_CORNERS][3]; // of shape functions, undeformed, 1/m
    double weight[PM_BEAM_POINTS];                       // m^3
    double volume;                                       // m^3, sum of the weights
} pm_beam_element;

typedef struct pm_beam_element_response {
    double force[PM_BEAM_FREEDOMS];                       // N, dE/dq at the corners
    double stiffness[PM_BEAM_FREEDOMS][PM_BEAM_FREEDOMS]; // N/m; upper triangle only
    double energy;                                        // J, stored
    double dissipated;                                    // J, in the step
    double stress[PM_SYMMETRIC];                          // Pa, Cauchy stress, mean over the points
} pm_beam_element_response;

// Sets up an element with the undeformed corners x [PM_BEAM_CORNERS][3], m, numbered as in VTK.
void pm_beam_element_init(pm_beam_element *element, const double *x);

// Computes the response at the corners' positions q [PM_BEAM_CORNERS][3], m, at the end of a step
// of h s. `before` [PM_BEAM_POINTS] holds the internal variables at the beginning of the step;
// `after` [PM_BEAM_POINTS] receives those at its end. Returns false if the element is turned inside
// out at a Gauss point.
bool pm_beam_element_respond(const pm_beam_element *element, const pm_beam_material *material,
                             double h, const double *q, const pm_beam_memory *before,
                             pm_beam_memory *after, pm_beam_element_response *response);

#endif
