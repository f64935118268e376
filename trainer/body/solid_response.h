// The response of a learned body to the forces of a field, compared with the field.
#ifndef PM_TRAINER_BODY_SOLID_RESPONSE_H
#define PM_TRAINER_BODY_SOLID_RESPONSE_H

#include "body/solid_data.h"

// How well the body follows one trajectory.
typedef struct pm_solid_response {
    double error[PM_SOLID_NSCORE]; // relative L2 errors over the trajectory
    double energy_residual;        // J, largest |change of stored energy + heat - work| of a step
    double least_heat;             // J, of a step
    int violations; // steps in which energy is not conserved to rounding, or heat is negative
    double work, work_of_forces; // J, of the body, and of the forces by the trapezoidal rule
    long steps, iterations;      // of all balances of forces
} pm_solid_response;

// Starts the undeformed body at the first state of trajectory i and lets the forces of the field
// act on it. `to` receives the positions, velocities, stresses, forces and energies in its
// trajectory `row`; NULL: nobody. `u` [nnode][3] and `sigma` [nnode][6] are work space.
// PM_ENUMERIC.
pm_status pm_solid_respond(const pm_solid_data *data, int i, pm_solid *solid, double *u,
                           double *sigma, pm_field *to, int row, pm_solid_response *response);

#endif
