// Rubber at a point, at finite strain: a Mooney-Rivlin spring beside Maxwell branches, all of them
// without the energy of volume, which belongs to the element. Per unit of undeformed volume, with
// Cbar = J^(-2/3) F^T F, mu = 2 (C10 + C01) and the symmetric inner strain A_i of each branch:
//     Psi = g_inf (C10 (I1 - 3) + C01 (I2 - 3)) + sum_i g_i mu/2 (Cbar : A_i - 3 - ln det A_i)
//     dA_i/dt = (Cbar^-1 - A_i) / tau_i,   g_inf = 1 - sum_i g_i
// (Linder, Tkachuk, Miehe, J. Mech. Phys. Solids 59, 2011). At held strain the stress of a branch
// decays as exp(-t/tau_i), whatever the strain: a Prony series. With x the eigenvalues of Cbar A_i,
//     dissipation = sum_i g_i mu / (2 tau_i) sum_x (x + 1/x - 2) >= 0.
#ifndef PM_BODIES_TRUTH_BEAM_MATERIAL_H
#define PM_BODIES_TRUTH_BEAM_MATERIAL_H

#include "bodies/truth/beam_tensor.h"

#define PM_BEAM_MAX_BRANCHES 3

typedef struct pm_beam_material {
    double C10, C01; // Pa, of the instantaneous response to a step of strain
    double D1;       // 1/Pa: energy of volume (J - 1)^2 / D1
    int nbranch;
    double g[PM_BEAM_MAX_BRANCHES];   // shares of the stress that relax; their sum is less than 1
    double tau[PM_BEAM_MAX_BRANCHES]; // s
} pm_beam_material;

// The internal variables of a material point.
typedef struct pm_beam_memory {
    double inverse[PM_SYMMETRIC];                     // Cbar^-1
    double inner[PM_BEAM_MAX_BRANCHES][PM_SYMMETRIC]; // A_i
} pm_beam_memory;

// The response of a material point.
typedef struct pm_beam_response {
    double J;                                   // det F
    double stress[PM_SYMMETRIC];                // Pa, deviatoric part of the Kirchhoff stress
    double tangent[PM_SYMMETRIC][PM_SYMMETRIC]; // Pa, its Lie derivative by the rate of deformation
    double energy;                              // J/m^3, Psi
    double dissipated;                          // J/m^3, in the step
} pm_beam_response;

// Sets the internal variables of an undeformed, relaxed point.
void pm_beam_memory_init(pm_beam_memory *memory);

// Computes the response to the deformation gradient F, with the determinant J > 0, at the end of a
// step of h s. `before` holds the internal variables at the beginning of the step; `after` receives
// those at its end. Cbar^-1 is taken as linear in time within the step, for which A_i is exact; the
// method is of second order in h. The tangent is consistent with this step.
void pm_beam_material_respond(const pm_beam_material *material, double h, const double F[9],
                              double J, const pm_beam_memory *before, pm_beam_memory *after,
                              pm_beam_response *response);

#endif
