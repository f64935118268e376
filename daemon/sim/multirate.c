// Substeps of rk4 between two exchanges.
#include "sim/multirate.h"

#include <string.h>

#include "sim/flux.h"

pm_status pm_multirate_open(pm_multirate *m, pm_arena *arena, int nz, int steps,
                            const pm_integrator *exchange) {
    const pm_integrator *own = pm_integrator_find("rk4");
    double *memory = pm_arena_array(arena, (size_t)(3 + own->nstage) * (size_t)nz, sizeof *memory);
    if (memory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the substeps of a subsystem");
    }
    *m = (pm_multirate){.nz = nz,
                        .steps = steps,
                        .exchange = exchange,
                        .own = own,
                        .forcing = memory,
                        .z = memory + 2 * (ptrdiff_t)nz,
                        .k = memory + 3 * (ptrdiff_t)nz};
    return PM_OK;
}

// Sets the contribution of the ports over an interval: its value at the start, and its slope.
static void set_forcing(pm_multirate *m, int interval, const double *k) {
    const pm_integrator *rk = m->exchange;
    memset(m->forcing, 0, 2 * (size_t)m->nz * sizeof *m->forcing);
    for (int i = 0; i <= interval; ++i) {
        const double start = rk->a[interval][i] / rk->width[interval];
        const double slope = rk->slope[interval][i] / rk->width[interval];
        for (int c = 0; c < m->nz; ++c) {
            m->forcing[c] += start * k[(ptrdiff_t)i * m->nz + c];
            m->forcing[m->nz + c] += slope * k[(ptrdiff_t)i * m->nz + c];
        }
    }
}

// Adds the fluxes of the bulk term at the last exposure to the sums.
static void book(const pm_multirate *m, const pm_local_dynamics *t, double weight, double duration,
                 const pm_multirate_books *books) {
    pm_flux_book(books->bulk, weight, m->nz, t->dE, t->dS, t->bulk_rate);
    if (books->projection != NULL) {
        pm_invariant_projection_book(books->projection, false, duration, m->nz, t->dE, t->dS,
                                     t->bulk_rate);
    }
}

// k = bulk term at m->z + contribution of the ports at `fraction` of the interval.
static void evaluate(pm_multirate *m, pm_local_dynamics *t, double fraction, double weight,
                     double duration, const pm_multirate_books *books, double *k) {
    int renewed = 0;
    for (int c = 0; c < m->nz; ++c) {
        k[c] = m->forcing[c] + fraction * m->forcing[m->nz + c];
    }
    if (t->bulk != NULL) {
        renewed += pm_local_dynamics_expose(t, m->z, NULL, NULL) == PM_EXPOSURE_EVALUATED;
        renewed += pm_local_dynamics_evaluate_bulk(t, m->z);
        book(m, t, weight, duration, books);
        for (int c = 0; c < m->nz; ++c) {
            k[c] += t->bulk_rate[c];
        }
    }
    *books->evaluated += renewed;
    *books->skipped += (t->bulk == NULL ? 1 : 2) - renewed;
}

// to = from + h sum_i weight_i k_i over the first n stages.
static void combine(const pm_multirate *m, int n, double h, const double *weight,
                    const double *from, double *to) {
    for (int c = 0; c < m->nz; ++c) {
        double sum = 0;
        for (int i = 0; i < n; ++i) {
            sum += weight[i] * m->k[(ptrdiff_t)i * m->nz + c];
        }
        to[c] = from[c] + h * sum;
    }
}

void pm_multirate_advance(pm_multirate *m, pm_local_dynamics *dynamics, int interval, double h,
                          double weight, const double *k, const pm_multirate_books *books,
                          double *z) {
    const pm_integrator *rk = m->own;
    const double part = m->exchange->width[interval] / m->steps; // fraction of the exchange step
    set_forcing(m, interval, k);
    for (int n = 0; n < m->steps; ++n) {
        for (int i = 0; i < rk->nstage; ++i) {
            combine(m, i, part * h, rk->a[i], z, m->z);
            const double fraction = (n + pm_integrator_time(rk, i)) / m->steps;
            evaluate(m, dynamics, fraction, weight * part * rk->b[i], h * part * rk->b[i], books,
                     m->k + (ptrdiff_t)i * m->nz);
        }
        combine(m, rk->nstage, part * h, rk->b, z, z);
    }
}
