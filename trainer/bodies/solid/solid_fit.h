// Learns a material from fields of bodies: displacements, stresses, forces, and stored and
// dissipated energies. The displacements of the data drive the learned body (pm_solid_follow), so
// that its inner variables, which no data show, follow from the learned relaxation. What remains of
// the balance of forces, times the inverse of the stiffness, is the error of the displacement.
// Levenberg and Marquardt's method minimises the sum of squares of
//   displacement, stress, stored and dissipated energy,
// each as a share of its size in the trajectory, and over the tolerance of that share.
#ifndef PM_BODIES_SOLID_SOLID_FIT_H
#define PM_BODIES_SOLID_SOLID_FIT_H

#include <signal.h>

#include "bodies/solid/solid_data.h"

typedef struct pm_solid_fit_settings {
    pm_solid_spec spec;
    int iterations;
    int ndata;
    const pm_solid_data *data;         // [ndata]
    const volatile sig_atomic_t *stop; // ends the fit after an iteration; NULL: never
    // Receives the number of the iteration (0: the start) and the root mean squares of the four
    // shares; NULL: nobody.
    void (*tell)(void *context, int iteration, const double score[PM_SOLID_NSCORE]);
    void *context;
} pm_solid_fit_settings;

// Sets the constants of the material from the data, and the weights to where a fit starts: nothing
// is known of the material. `params` are those of pm_solid_material_declare. PM_ENOMEM.
pm_status pm_solid_fit_start(const pm_solid_fit_settings *settings, pm_params *params);
// Changes the weights to fit the data, and returns the root mean squares of the shares in score.
// PM_ENUMERIC: the start fails. PM_ENOMEM.
pm_status pm_solid_fit(const pm_solid_fit_settings *settings, pm_params *params,
                       double score[PM_SOLID_NSCORE]);

#endif
