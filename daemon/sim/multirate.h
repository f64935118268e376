// Steps of a part's own between two exchanges, for multirate integrators: over one interval of an
// exchange step the part is carried by its bulk term, in steps of rk4, while what its ports give is
// a known line in time, made of the rates at the exchanges so far (Sandu, SIAM J. Numer. Anal. 57
// (2019) 2300). Every part takes as many steps per interval as its `substeps` in the scene, so that
// a fast part costs its neighbours and the network nothing.
//
// Exact, whatever the steps: what is booked. Every exchange is one pair of fluxes, taken by both
// ends from the same numbers and booked with weights >= 0, so that both laws hold in the ledger as
// with other methods; and what flows into a variable, such as an entropy that is one, is what was
// booked. The total energy, and states, are so to the order of the method: h^3 in the exchanges,
// and (h/n)^4 in n steps of a part. The balanced method brings a part's energy and entropy to what
// was booked.
#ifndef PM_SIM_MULTIRATE_H
#define PM_SIM_MULTIRATE_H

#include "sim/invariant_projection.h"
#include "sim/local_dynamics.h"
#include "sim/port_instance.h"

typedef struct pm_multirate {
    int nz, steps; // per interval
    const pm_integrator *exchange, *own;
    double *forcing; // [2][nz] from ports: at the interval's start, and its slope over it
    double *z, *k;   // [nz], [own->nstage][nz]
} pm_multirate;

// What a part books on its way.
typedef struct pm_multirate_books {
    pm_flux *bulk;
    long *evaluated, *skipped;
    pm_invariant_projection *balance; // NULL: the method is not balanced
} pm_multirate_books;

// Memory from the arena. PM_ENOMEM.
pm_status pm_multirate_open(pm_multirate *m, pm_arena *arena, int nz, int steps,
                            const pm_integrator *exchange);

// Carries z [nz] over interval `interval` of an exchange step of h, with the ports' rates
// k [interval + 1][nz]. `weight` is that of the exchange step in what is booked.
void pm_multirate_advance(pm_multirate *m, pm_local_dynamics *terms, int interval, double h,
                          double weight, const double *k, const pm_multirate_books *books,
                          double *z);

#endif
