// Computes the fluxes of a step: the mean of co-energies times rates over its stages.
#ifndef PM_SIM_FLUX_H
#define PM_SIM_FLUX_H

#include "scene/recording.h"

// Adds weight times the power e . rate (W) and weight times the entropy rate eta . rate (W/K) to a
// flux, and weight times the sums of magnitudes to its gross fluxes. e, eta and rate are [n]; e or
// eta may be NULL: zero. `weight` is the weight of the stage in the mean over the step.
void pm_flux_book(pm_flux *flux, double weight, int n, const double *e, const double *eta,
                  const double *rate);

#endif
