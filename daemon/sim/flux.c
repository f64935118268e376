// Sums co-energies times rates over the components, in a fixed order.
#include "sim/flux.h"

#include <math.h>

static double value_at(const double *covector, int i) {
    return covector == NULL ? 0 : covector[i];
}

void pm_flux_book(pm_flux *flux, double weight, int n, const double *e, const double *eta,
                  const double *rate) {
    pm_flux sum = {0};
    for (int i = 0; i < n; ++i) {
        const double power = value_at(e, i) * rate[i], production = value_at(eta, i) * rate[i];
        sum.energy += weight * power;
        sum.entropy += weight * production;
        sum.energy_gross += weight * fabs(power);
        sum.entropy_gross += weight * fabs(production);
    }
    flux->energy += sum.energy;
    flux->entropy += sum.entropy;
    flux->energy_gross += sum.energy_gross;
    flux->entropy_gross += sum.entropy_gross;
}
