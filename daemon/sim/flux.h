// Sums up fluxes: the mean of co-energies times rates over a step.
#ifndef PM_SIM_FLUX_H
#define PM_SIM_FLUX_H

#include "scene/recording.h"

// Adds the power e . rate (W) and the entropy production eta . rate (W/K) of one term [n], times
// the weight of the stage in the mean over the step, to a flux; likewise its gross fluxes, which
// sum the magnitudes. e or eta may be NULL: zero.
void pm_flux_book(pm_flux *flux, double weight, int n, const double *e, const double *eta,
                  const double *rate);

#endif
