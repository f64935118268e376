// Runs the three steps that fit a basis, and projects fields on a basis.
#include "modal/reduce.h"

#include <assert.h>
#include <string.h>

#include "modal/reduce_creep.h"
#include "modal/reduce_modes.h"
#include "modal/reduce_patterns.h"

pm_status pm_reduce_fit(pm_basis **basis, const pm_field *field, int count, const int *trajectory,
                        const pm_reduce_settings *settings) {
    pm_reduction r = {
        .field = field, .settings = settings, .count = count, .trajectory = trajectory};
    pm_basis *b = NULL;
    pm_status status;
    assert(settings->nmode <= PM_BASIS_MAX_MODES && settings->nbranch <= PM_BASIS_MAX_BRANCHES);
    PM_TRY_DONE(pm_reduction_open(&r, settings->nmode, settings->nbranch, settings->square,
                                  PM_LOADS_OF_ALL, true));
    PM_TRY_DONE(pm_reduce_modes(&r, &b));
    PM_TRY_DONE(pm_reduce_creep(&r, b));
    PM_TRY_DONE(pm_reduce_patterns(&r, b));
    *basis = b;
    b = NULL;
done:
    pm_basis_free(b);
    pm_reduction_close(&r);
    return status;
}

// --- projection ---

// Makes the names of the columns; NULL if memory is exhausted.
static const char **name_columns(const pm_basis *b, int count, pm_arena *arena) {
    const char **name = pm_arena_array(arena, (size_t)count, sizeof *name);
    int at = 0;
    if (name == NULL) {
        return NULL;
    }
    for (int g = 0; g < 2; ++g) {
        for (int i = 0; i < b->nstate; ++i) {
            name[at++] = pm_arena_printf(arena, "%c%d", "ap"[g], i);
        }
    }
    for (int k = 0; k < b->nbranch; ++k) {
        for (int i = 0; i < b->nstate; ++i) {
            name[at++] = pm_arena_printf(arena, "c%d_%d", k, i);
        }
    }
    name[at++] = "s";
    for (int i = 0; i < b->nmode; ++i) {
        name[at++] = i < b->nstate ? pm_arena_printf(arena, "f%d", i)
                                   : pm_arena_printf(arena, "h%d", i - b->nstate);
    }
    for (int i = 0; i < count; ++i) {
        if (name[i] == NULL) {
            return NULL;
        }
    }
    return name;
}

// Returns the rate at time j of a series with `stride` numbers per time, by differences of second
// order.
static double difference(const double *value, int stride, int ntime, int j, double dt) {
    if (ntime < 3) {
        return 0;
    }
    const double *at = value + (ptrdiff_t)j * stride;
    if (j == 0) {
        return (4 * at[stride] - 3 * at[0] - at[2 * (ptrdiff_t)stride]) / (2 * dt);
    }
    if (j == ntime - 1) {
        return (3 * at[0] - 4 * at[-stride] + at[-2 * (ptrdiff_t)stride]) / (2 * dt);
    }
    return (at[stride] - at[-stride]) / (2 * dt);
}

// Writes the state at time j as a row of the dataset, and its rates.
static void write_row(const pm_modal_trajectory *p, const pm_basis *b, double dt,
                      const double *dissipated, int j, double *z, double *zdot) {
    const int n = b->nstate;
    const ptrdiff_t at = (ptrdiff_t)j * p->nmode;
    for (int i = 0; i < n; ++i) {
        const double rate = difference(p->a + i, p->nmode, p->ntime, j, dt);
        z[i] = p->a[at + i];
        z[n + i] = b->inertia_time * b->inertia_time * rate;
        zdot[i] = rate;
        zdot[n + i] = 0; // the motion is quasi-static
    }
    for (int k = 0; k < b->nbranch; ++k) {
        const double *c = p->c + (ptrdiff_t)k * p->ntime * p->nmode + at;
        for (int i = 0; i < n; ++i) {
            z[(2 + k) * n + i] = c[i];
            zdot[(2 + k) * n + i] = (p->a[at + i] - c[i]) / b->tau[k];
        }
    }
    const int s = (2 + b->nbranch) * n;
    if (dissipated != NULL) {
        z[s] = dissipated[(ptrdiff_t)j * PM_FIELD_ENERGIES] / b->temperature;
        zdot[s] = difference(dissipated, PM_FIELD_ENERGIES, p->ntime, j, dt) / b->temperature;
    }
    memcpy(z + s + 1, p->load + at, (size_t)b->nmode * sizeof *z);
}

pm_status pm_reduce_project(pm_dataset **dataset, const pm_basis *basis, const pm_field *field,
                            int count, const int *trajectory, bool square, pm_load_kind loads) {
    pm_reduction r = {.field = field};
    const int ncolumn = (2 + basis->nbranch) * basis->nstate + 1 + basis->nmode;
    pm_dataset *d = NULL;
    pm_status status;
    if (field->nnode != basis->nnode) {
        return pm_fail(PM_EDATA, "the field has %d nodes, the basis %d", field->nnode,
                       basis->nnode);
    }
    PM_TRY_DONE(pm_reduction_open(&r, basis->nmode, basis->nbranch, square, loads, false));
    const char **name = name_columns(basis, ncolumn, &r.arena);
    if (name == NULL) {
        status = pm_reduction_no_memory();
        goto done;
    }
    PM_TRY_DONE(pm_dataset_new(&d, count * r.ncopy, field->ntime, ncolumn, field->dt, name));
    PM_TRY_DONE(pm_dataset_with_rates(d));
    for (int i = 0; i < d->ntrajectory; ++i) {
        const int from = trajectory[i / r.ncopy];
        pm_modal_trajectory_read(&r.modal, field, from, &r.copy[i % r.ncopy]);
        pm_modal_trajectory_project(&r.modal, basis, field->dt);
        const double *dissipated =
            field->energy == NULL
                ? NULL
                : field->energy + (ptrdiff_t)from * field->ntime * PM_FIELD_ENERGIES + 1;
        for (int j = 0; j < d->ntime; ++j) {
            write_row(&r.modal, basis, field->dt, dissipated, j, pm_dataset_state(d, i, j),
                      pm_dataset_rate(d, i, j));
        }
    }
    *dataset = d;
    d = NULL;
done:
    pm_dataset_free(d);
    pm_reduction_close(&r);
    return status;
}
