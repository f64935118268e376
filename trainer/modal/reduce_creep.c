// Fits the shares of the branches, and solves for the retardation times.
#include "modal/reduce_creep.h"

#include <math.h>
#include <stdlib.h>

#include "base/linalg.h"
#include "modal/regression.h"

// The internal variables of branches with similar times are nearly dependent. This ridge determines
// their shares all the same.
#define RIDGE 1e-7
// The smallest share of the stiffness that remains when all branches have relaxed. Without it a
// fitted sum of shares of 1 would give an infinite time.
#define REMAINS 0.01

typedef struct share_fit {
    const pm_basis *b;
    pm_regression regression;
    double *c;    // [ntime * nstate][nbranch] J^0.5
    double *rest; // [ntime * nstate] J^0.5, amplitude less load
} share_fit;

static pm_status add_balance(pm_reduction *r, double weight, void *context) {
    share_fit *x = context;
    const pm_modal_trajectory *p = &r->modal;
    const int n = x->b->nstate;
    pm_modal_trajectory_project(&r->modal, x->b, r->field->dt);
    for (int row = 0; row < p->ntime * n; ++row) {
        const ptrdiff_t at = (ptrdiff_t)(row / n) * p->nmode + row % n;
        x->rest[row] = weight * (p->a[at] - p->load[at]);
        for (int k = 0; k < p->nbranch; ++k) {
            x->c[row * p->nbranch + k] = weight * p->c[(ptrdiff_t)k * p->ntime * p->nmode + at];
        }
    }
    pm_regression_add(&x->regression, p->ntime * n, x->c, x->rest);
    return PM_OK;
}

// Computes the retardation times from the shares [nbranch], longest first.
static pm_status solve_times(pm_basis *b, double *share) {
    double square[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_BRANCHES];
    double vector[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_BRANCHES];
    const int n = b->nbranch;
    double remains = 1;
    for (int k = 0; k < n; ++k) {
        share[k] = fmax(share[k], 0);
        remains -= share[k];
    }
    for (int k = 0; k < n; ++k) {
        for (int l = 0; l < n; ++l) {
            square[k * n + l] =
                sqrt(share[k] * b->tau[k] * share[l] * b->tau[l]) / fmax(remains, REMAINS) +
                (k == l ? b->tau[k] : 0);
        }
    }
    if (!pm_eigen_largest(n, square, n, b->retardation, vector)) {
        return pm_fail(PM_ENUMERIC, "no retardation times for %d relaxation times", n);
    }
    b->nretardation = n;
    return PM_OK;
}

pm_status pm_reduce_creep(pm_reduction *r, pm_basis *basis) {
    const size_t count = (size_t)r->modal.ntime * (size_t)basis->nstate;
    share_fit x = {.b = basis,
                   .c = calloc(count * (size_t)basis->nbranch + 1, sizeof(double)),
                   .rest = calloc(count, sizeof(double))};
    pm_status status = x.c == NULL || x.rest == NULL ? pm_reduction_no_memory() : PM_OK;
    if (status != PM_OK || basis->nbranch == 0) {
        goto done;
    }
    PM_TRY_DONE(pm_regression_open(&x.regression, basis->nbranch, 1));
    PM_TRY_DONE(pm_reduction_for_each(r, add_balance, &x));
    PM_TRY_DONE(pm_regression_solve(&x.regression, RIDGE));
    status = solve_times(basis, x.regression.cross);
done:
    pm_regression_close(&x.regression);
    free(x.c);
    free(x.rest);
    return status;
}
