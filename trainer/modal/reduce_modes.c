// Decomposes the displacements, fits the flexibility, rotates and orders the modes.
#include "modal/reduce_modes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "modal/regression.h"

// Only every STRIDE-th state enters the decomposition, because neighbours in time are similar.
#define STRIDE 3
// The features are linearly dependent. This ridge is just large enough to keep coefficients small
// that the data do not determine; a larger ridge would soften the modes.
#define RIDGE 1e-7
// A mode belongs to the state if its load is at least this fraction of its elastic force. For
// relaxed rubber a load of a fifth is in equilibrium with the elastic force. A mode with a smaller
// load is moved by other modes.
#define DRIVEN 0.25
// The smallest flexibility of a mode, relative to the softest one. For a nearly rigid mode the
// regression finds a flexibility of zero or less.
#define STIFFEST 1e-6

// --- proper orthogonal decomposition ---

typedef struct decomposition {
    double *gram; // [3 nnode][3 nnode]
    double *row;  // [ntime / STRIDE][3 nnode]
} decomposition;

static pm_status add_snapshots(pm_reduction *r, double weight, void *context) {
    const decomposition *d = context;
    const int width = 3 * r->modal.nnode;
    int count = 0;
    for (int j = STRIDE - 1; j < r->modal.ntime; j += STRIDE, ++count) {
        for (int i = 0; i < width; ++i) {
            d->row[(ptrdiff_t)count * width + i] = weight * r->modal.u[(ptrdiff_t)j * width + i];
        }
    }
    pm_gram_add(count, width, d->row, d->gram);
    return PM_OK;
}

// Makes the modes orthonormal eigenvectors of the displacements.
static pm_status decompose(pm_reduction *r, pm_basis *b) {
    const size_t width = 3 * (size_t)r->field->nnode;
    decomposition d = {calloc(width * width, sizeof(double)),
                       calloc((size_t)r->modal.ntime * width, sizeof(double))};
    double *value = calloc((size_t)b->nmode, sizeof *value);
    pm_status status =
        d.gram == NULL || d.row == NULL || value == NULL ? pm_reduction_no_memory() : PM_OK;
    if (status == PM_OK) {
        status = pm_reduction_for_each(r, add_snapshots, &d);
    }
    if (status == PM_OK && !pm_eigen_largest((int)width, d.gram, b->nmode, value, b->mode)) {
        status = pm_fail(PM_ENUMERIC, "no modes of the displacements");
    }
    for (int i = 0; i < b->nmode; ++i) {
        b->stiffness[i] = 1;
    }
    free(d.gram);
    free(d.row);
    free(value);
    return status;
}

// --- flexibility ---

// The regression of the amplitudes on all features but the amplitudes themselves: internal
// variables, loads and products.
typedef struct flexibility {
    pm_basis *b;
    pm_regression regression;
    double *all, *feature, *result; // [ntime] rows
    double *loads, *amplitudes;     // [nmode] sums of squares
} flexibility;

// Finds the largest leading amplitudes.
static pm_status find_lead_scale(pm_reduction *r, double weight, void *context) {
    (void)weight;
    pm_basis *b = context;
    pm_modal_trajectory_project(&r->modal, b, r->field->dt);
    for (int j = 0; j < r->modal.ntime; ++j) {
        for (int i = 0; i < b->nlead; ++i) {
            const double size = fabs(r->modal.a[(ptrdiff_t)j * r->modal.nmode + i]);
            b->lead_scale[i] = fmax(b->lead_scale[i], size);
        }
    }
    return PM_OK;
}

// Adds the states of a trajectory to the regression.
static pm_status add_flexibility(pm_reduction *r, double weight, void *context) {
    flexibility *x = context;
    const pm_modal_trajectory *p = &r->modal;
    const int n = x->b->nstate, count = pm_basis_features(x->b), used = count - n;
    double c[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_MODES];
    pm_modal_trajectory_project(&r->modal, x->b, r->field->dt);
    for (int j = 0; j < p->ntime; ++j) {
        pm_modal_state state;
        pm_modal_trajectory_state(p, x->b, j, c, &state);
        pm_basis_fill_features(x->b, &state, x->all);
        for (int i = 0; i < used; ++i) {
            x->feature[(ptrdiff_t)j * used + i] = weight * x->all[n + i];
        }
        for (int i = 0; i < n; ++i) {
            x->result[(ptrdiff_t)j * n + i] = weight * state.a[i];
        }
    }
    pm_regression_add(&x->regression, p->ntime, x->feature, x->result);
    return PM_OK;
}

// Takes the symmetric part of da/d(load), in coordinates in which all modes have stiffness 1.
static void take_flexibility(const flexibility *x, double *square) {
    const int n = x->b->nstate, skip = x->b->nbranch * n;
    const double *cross = x->regression.cross + (ptrdiff_t)skip * n;
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
            square[i * n + j] = 0.5 * (cross[i * n + j] + cross[j * n + i]);
        }
    }
}

// Rotates the modes by vector [nmode][nmode] and scales them by their flexibility.
static pm_status rotate_modes(pm_basis *b, const double *value, const double *vector) {
    const size_t width = 3 * (size_t)b->nnode, n = (size_t)b->nmode;
    double *turned = malloc(n * width * sizeof *turned);
    if (turned == NULL) {
        return pm_reduction_no_memory();
    }
    pm_gemm(false, false, b->nmode, (int)width, b->nmode, vector, b->mode, turned);
    for (size_t i = 0; i < n; ++i) {
        const double softness = fmax(value[i], STIFFEST * value[0]);
        b->stiffness[i] = 1 / softness;
        for (size_t k = 0; k < width; ++k) {
            b->mode[i * width + k] = sqrt(softness) * turned[i * width + k];
        }
    }
    free(turned);
    return PM_OK;
}

// Returns a measure of the work of the loads on a mode, which does not depend on the unit of its
// amplitude.
static double work_of(const flexibility *x, int mode) {
    return x->amplitudes[mode] * x->loads[mode];
}

// Orders the modes: first those that carry the energy, at most `most`, softest first; then the
// others by the work of the loads on them. Returns the number of modes that carry the energy.
static int order_modes(const flexibility *x, int most, int *order) {
    const int n = x->b->nmode;
    int count = 0, rest = 0;
    int *other = order + n;
    for (int i = 0; i < n; ++i) {
        const bool driven = x->loads[i] > DRIVEN * DRIVEN * x->amplitudes[i];
        if (driven && count < most) {
            order[count++] = i;
        } else {
            int at = rest++;
            for (; at > 0 && work_of(x, other[at - 1]) < work_of(x, i); --at) {
                other[at] = other[at - 1];
            }
            other[at] = i;
        }
    }
    memcpy(order + count, other, (size_t)rest * sizeof *order);
    return count;
}

// Adds up the squares of amplitudes and loads. They are not weighted, because modes accompany
// others most at large deflections.
static pm_status measure_modes(pm_reduction *r, double weight, void *context) {
    (void)weight;
    const flexibility *x = context;
    const pm_modal_trajectory *p = &r->modal;
    pm_modal_trajectory_project(&r->modal, x->b, r->field->dt);
    for (int j = 0; j < p->ntime; ++j) {
        for (int i = 0; i < p->nmode; ++i) {
            const double a = p->a[(ptrdiff_t)j * p->nmode + i];
            const double load = p->load[(ptrdiff_t)j * p->nmode + i];
            x->amplitudes[i] += a * a;
            x->loads[i] += load * load;
        }
    }
    return PM_OK;
}

// Fits the flexibility and rotates the modes to its eigenvectors.
static pm_status find_flexibility(pm_reduction *r, flexibility *x) {
    const int n = x->b->nmode;
    double *square = calloc((size_t)(n * n), sizeof *square);
    double *vector = calloc((size_t)(n * n), sizeof *vector);
    double *value = calloc((size_t)n, sizeof *value);
    pm_status status;
    if (square == NULL || vector == NULL || value == NULL) {
        status = pm_reduction_no_memory();
        goto done;
    }
    PM_TRY_DONE(pm_reduction_for_each(r, find_lead_scale, x->b));
    PM_TRY_DONE(pm_reduction_for_each(r, add_flexibility, x));
    PM_TRY_DONE(pm_regression_solve(&x->regression, RIDGE));
    take_flexibility(x, square);
    if (!pm_eigen_largest(n, square, n, value, vector)) {
        status = pm_fail(PM_ENUMERIC, "no eigenvectors of the flexibility");
        goto done;
    }
    PM_TRY_DONE(rotate_modes(x->b, value, vector));
    status = pm_reduction_for_each(r, measure_modes, x);
done:
    free(square);
    free(vector);
    free(value);
    return status;
}

static pm_status open_flexibility(pm_reduction *r, flexibility *x, pm_basis *b) {
    const int count = pm_basis_features(b), n = b->nmode;
    const size_t ntime = (size_t)r->modal.ntime;
    x->b = b;
    x->all = pm_arena_array(&r->arena, (size_t)count, sizeof(double));
    x->feature = pm_arena_array(&r->arena, ntime * (size_t)count, sizeof(double));
    x->result = pm_arena_array(&r->arena, ntime * (size_t)n, sizeof(double));
    x->loads = pm_arena_array(&r->arena, (size_t)n, sizeof(double));
    x->amplitudes = pm_arena_array(&r->arena, (size_t)n, sizeof(double));
    if (x->all == NULL || x->feature == NULL || x->result == NULL || x->loads == NULL ||
        x->amplitudes == NULL) {
        return pm_reduction_no_memory();
    }
    return pm_regression_open(&x->regression, count - n, n);
}

// --- the final basis ---

static pm_status set_constants(pm_basis *b, const pm_reduce_settings *settings,
                               const pm_field *field) {
    b->nbranch = settings->nbranch;
    memcpy(b->tau, settings->tau, sizeof b->tau);
    b->inertia_time = settings->inertia_time;
    b->temperature = settings->temperature;
    memcpy(b->position, field->position, 3 * (size_t)field->nnode * sizeof *b->position);
    if (field->hexahedron == NULL) {
        return PM_OK;
    }
    PM_TRY(pm_basis_add_mesh(b, field->nelement));
    memcpy(b->hexahedron, field->hexahedron, 8 * (size_t)b->nelement * sizeof *b->hexahedron);
    return PM_OK;
}

// Makes the final basis from the modes in their order.
static pm_status pick_modes(pm_reduction *r, const flexibility *x, pm_basis **basis) {
    const pm_basis *all = x->b;
    const size_t width = 3 * (size_t)all->nnode;
    int order[2 * PM_BASIS_MAX_MODES];
    const int nstate = order_modes(x, r->settings->nstate, order);
    if (nstate == 0) {
        return pm_fail(PM_EDATA, "no mode of the displacements follows the loads");
    }
    const int nlead = nstate < r->settings->nlead ? nstate : r->settings->nlead;
    PM_TRY(pm_basis_new(basis, all->nnode, all->nmode, nstate, nlead));
    PM_TRY(set_constants(*basis, r->settings, r->field));
    for (int i = 0; i < all->nmode; ++i) {
        memcpy((*basis)->mode + (size_t)i * width, all->mode + (size_t)order[i] * width,
               width * sizeof *all->mode);
        (*basis)->stiffness[i] = all->stiffness[order[i]];
    }
    return pm_reduction_for_each(r, find_lead_scale, *basis);
}

pm_status pm_reduce_modes(pm_reduction *r, pm_basis **basis) {
    const pm_reduce_settings *settings = r->settings;
    const int nlead = settings->nlead < settings->nmode ? settings->nlead : settings->nmode;
    pm_basis *all = NULL;
    flexibility x = {0};
    pm_status status;
    PM_TRY_DONE(pm_basis_new(&all, r->field->nnode, settings->nmode, settings->nmode, nlead));
    PM_TRY_DONE(set_constants(all, settings, r->field));
    PM_TRY_DONE(decompose(r, all));
    PM_TRY_DONE(open_flexibility(r, &x, all));
    PM_TRY_DONE(find_flexibility(r, &x));
    status = pick_modes(r, &x, basis);
done:
    pm_regression_close(&x.regression);
    pm_basis_free(all);
    return status;
}
