// The substeps of a single subsystem between two exchanges, for multirate integrators (Sandu, SIAM
// J. Numer. Anal. 57 (2019) 2300). Over one interval of an exchange step the subsystem integrates
// its bulk term in steps of rk4. The contribution of its ports is meanwhile a linear function of
// time, which follows from the rates at the exchanges so far. Every subsystem takes as many steps
// per interval as its `substeps` in the scene says. A fast subsystem therefore causes no extra work
// for its neighbours and the network.
//
// The fluxes in the ledger are exact for any number of steps. Both ends of a port take the rates of
// each exchange from the same numbers and sum them with weights >= 0. Conservation of energy and
// growth of entropy therefore hold in the ledger, as with other methods. States and the total
// energy are accurate to the order of the method: h^3 in the exchange step h, and (h/n)^4 in n
// steps of a subsystem. The balanced method also brings each subsystem's energy and entropy to the
// totals that follow from the fluxes (invariant_projection.h).
#ifndef PM_SIM_MULTIRATE_H
#define PM_SIM_MULTIRATE_H

#include "scene/recording.h"
#include "sim/invariant_projection.h"
#include "sim/local_dynamics.h"

typedef struct pm_multirate {
    int nz, steps;                 // components; steps per interval
    const pm_integrator *exchange; // the multirate method
    const pm_integrator *own;      // rk4, of the steps in between
    double *forcing; // [2][nz] the ports' rate at the start of an interval, and its change over it
    double *z;       // [nz] stage state
    double *k;       // [own->nstage][nz] rates of the stages
} pm_multirate;

// The sums and counts to which the substeps of a subsystem add.
typedef struct pm_multirate_books {
    pm_flux *bulk;
    long *evaluated, *skipped;
    pm_invariant_projection *projection; // NULL: the method is not balanced
} pm_multirate_books;

// Prepares the substeps of a subsystem of nz components, which takes `steps` steps per interval of
// the multirate method `exchange`. Memory comes from the arena. PM_ENOMEM.
pm_status pm_multirate_open(pm_multirate *m, pm_arena *arena, int nz, int steps,
                            const pm_integrator *exchange);

// Integrates z [nz] over interval number `interval` of an exchange step of length h (s), with the
// rates k [interval + 1][nz] of the ports. `weight` is the weight of the exchange step in the mean
// fluxes.
void pm_multirate_advance(pm_multirate *m, pm_local_dynamics *dynamics, int interval, double h,
                          double weight, const double *k, const pm_multirate_books *books,
                          double *z);

#endif
