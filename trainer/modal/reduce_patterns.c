// The patterns of a basis: all that the state's modes leave of the displacements, and the stresses,
// as functions of its features; and what of the stresses is local to the loads.
#include <string.h>

#include "modal/reduction.h"
#include "modal/regression.h"

// Every so many states count in what is local: neighbours in time are alike.
#define STRIDE 3
// The ridge of patterns is the square of how far off, relatively, a predicted state is taken to be:
// the features depend on each other, and what tells them apart must not be taken for true.
#define PATTERN_RIDGE 1e-4
static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a reduction");
}

// --- patterns ---

typedef struct remainder_fit {
    const pm_basis *b;
    pm_regression displacement, stress;
    double *feature, *displaced, *stressed; // [ntime] rows
    double *work;                           // pm_local_work numbers
} remainder_fit;

// u less what the state's modes are, times the weight.
static void subtract_modes(const pm_path *p, const pm_basis *b, int time, double weight,
                           double *rest) {
    const int width = 3 * p->nnode;
    const double *a = p->a + (ptrdiff_t)time * p->nmode;
    for (int k = 0; k < width; ++k) {
        rest[k] = weight * p->u[(ptrdiff_t)time * width + k];
    }
    for (int i = 0; i < b->nstate; ++i) {
        for (int k = 0; k < width; ++k) {
            rest[k] -= weight * a[i] * b->mode[(ptrdiff_t)i * width + k];
        }
    }
}

// Stress less what is local, times the weight.
static void subtract_local(const pm_path *p, const remainder_fit *x, int time, double weight) {
    const ptrdiff_t width = PM_BASIS_TENSOR * (ptrdiff_t)p->nnode, at = time * width;
    double *rest = x->stressed + at;
    memset(rest, 0, (size_t)width * sizeof *rest);
    pm_local_add(&x->b->local, p->f + 3 * (ptrdiff_t)time * p->nnode, rest, x->work);
    for (ptrdiff_t i = 0; i < width; ++i) {
        rest[i] = weight * (p->stress[at + i] - rest[i]);
    }
}

static pm_status add_rest(pm_reduction *r, double weight, void *context) {
    remainder_fit *x = context;
    const pm_path *p = &r->path;
    const int count = pm_basis_features(x->b), width = 3 * p->nnode;
    double c[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_MODES];
    pm_path_project(&r->path, x->b, r->field->dt);
    // Stress is weighed by its own size, so that its units do not matter.
    const double stressed =
        p->stress == NULL ? 0
                          : 1 / pm_reduction_norm(2 * (size_t)width * (size_t)p->ntime, p->stress);
    for (int j = 0; j < p->ntime; ++j) {
        pm_reading reading;
        double *feature = x->feature + (ptrdiff_t)j * count;
        pm_path_read(p, x->b, j, c, &reading);
        pm_basis_fill_features(x->b, &reading, feature);
        for (int i = 0; i < count; ++i) {
            feature[i] *= weight;
        }
        subtract_modes(p, x->b, j, weight, x->displaced + (ptrdiff_t)j * width);
    }
    pm_regression_add(&x->displacement, p->ntime, x->feature, x->displaced);
    if (p->stress != NULL) {
        for (ptrdiff_t i = 0; i < (ptrdiff_t)p->ntime * count; ++i) {
            x->feature[i] *= stressed / weight;
        }
        for (int j = 0; j < p->ntime; ++j) {
            subtract_local(p, x, j, stressed);
        }
        pm_regression_add(&x->stress, p->ntime, x->feature, x->stressed);
    }
    return PM_OK;
}

static pm_status make_pattern(pm_basis *b, pm_regression *fit, pm_pattern *pattern, int rank) {
    const int most = fit->nfeature < fit->nresult ? fit->nfeature : fit->nresult;
    PM_TRY(pm_basis_add_pattern(b, pattern, rank < most ? rank : most, fit->nresult));
    PM_TRY(pm_regression_solve(fit, PATTERN_RIDGE));
    return pm_regression_compress(fit, pattern->rank, pattern->coefficient, pattern->pattern);
}

static pm_status fit_patterns(pm_reduction *r, pm_basis *b) {
    const int count = pm_basis_features(b), width = 3 * b->nnode;
    const size_t ntime = (size_t)r->path.ntime;
    remainder_fit x = {
        .b = b,
        .feature = pm_arena_array(&r->arena, ntime * (size_t)count, sizeof(double)),
        .displaced = pm_arena_array(&r->arena, ntime * (size_t)width, sizeof(double)),
        .stressed = pm_arena_array(&r->arena, 2 * ntime * (size_t)width, sizeof(double)),
        .work = pm_arena_array(&r->arena, pm_local_work(&b->local), sizeof(double)),
    };
    const bool stress = r->path.stress != NULL;
    pm_status status;
    if (x.feature == NULL || x.displaced == NULL || x.stressed == NULL || x.work == NULL) {
        return no_memory();
    }
    PM_TRY_DONE(pm_regression_open(&x.displacement, count, width));
    if (stress) {
        PM_TRY_DONE(pm_regression_open(&x.stress, count, 2 * width));
    }
    PM_TRY_DONE(pm_reduction_for_each(r, add_rest, &x));
    PM_TRY_DONE(make_pattern(b, &x.displacement, &b->displacement, r->how->displacement_rank));
    status = stress ? make_pattern(b, &x.stress, &b->stress, r->how->stress_rank) : PM_OK;
done:
    pm_regression_close(&x.displacement);
    pm_regression_close(&x.stress);
    return status;
}

// --- what is local ---

typedef struct local_fit {
    const pm_basis *b;
    pm_regression regression;
    int *carries;                       // [nnode]
    double *feature, *stress;           // of one time: features of the basis, [nnode][6]
    double *local_feature, *local_rest; // [nsection] rows
} local_fit;

static pm_status find_loaded(pm_reduction *r, double weight, void *context) {
    (void)weight;
    const local_fit *x = context;
    const pm_path *p = &r->path;
    for (ptrdiff_t i = 0; i < 3 * (ptrdiff_t)p->ntime * p->nnode; ++i) {
        x->carries[i / 3 % p->nnode] |= p->f[i] != 0;
    }
    return PM_OK;
}

// Stress at a time less what the pattern makes of it.
static void subtract_pattern(const local_fit *x, const pm_path *p, int time) {
    const int width = PM_BASIS_TENSOR * p->nnode;
    double c[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_MODES];
    pm_reading reading;
    pm_path_read(p, x->b, time, c, &reading);
    pm_basis_fill_features(x->b, &reading, x->feature);
    memset(x->stress, 0, (size_t)width * sizeof *x->stress);
    pm_pattern_add(&x->b->stress, pm_basis_features(x->b), x->feature, x->stress);
    for (int i = 0; i < width; ++i) {
        x->stress[i] = p->stress[(ptrdiff_t)time * width + i] - x->stress[i];
    }
}

static pm_status add_local(pm_reduction *r, double weight, void *context) {
    (void)weight;
    local_fit *x = context;
    const pm_path *p = &r->path;
    const pm_local *local = &x->b->local;
    const int count = pm_local_features(local), width = PM_LOCAL_TENSOR * local->nper;
    const size_t all = (size_t)PM_LOCAL_TENSOR * (size_t)p->nnode * (size_t)p->ntime;
    const double scale = 1 / pm_reduction_norm(all, p->stress);
    pm_path_project(&r->path, x->b, r->field->dt);
    for (int j = STRIDE - 1; j < p->ntime; j += STRIDE) {
        subtract_pattern(x, p, j);
        for (int k = 0; k < local->nsection; ++k) {
            double *feature = x->local_feature + (ptrdiff_t)k * count;
            pm_local_fill_features(local, p->f + 3 * (ptrdiff_t)j * p->nnode, k, feature);
            for (int i = 0; i < count; ++i) {
                feature[i] *= scale;
            }
            for (int i = 0; i < width; ++i) {
                const int node = local->node[k * local->nper + i / PM_LOCAL_TENSOR];
                x->local_rest[(ptrdiff_t)k * width + i] =
                    scale * x->stress[PM_LOCAL_TENSOR * node + i % PM_LOCAL_TENSOR];
            }
        }
        pm_regression_add(&x->regression, local->nsection, x->local_feature, x->local_rest);
    }
    return PM_OK;
}

static pm_status open_local(pm_reduction *r, pm_basis *b, local_fit *x) {
    pm_local *local = &b->local;
    const size_t nnode = (size_t)b->nnode;
    x->b = b;
    x->carries = pm_arena_array(&r->arena, nnode, sizeof *x->carries);
    x->feature = pm_arena_array(&r->arena, (size_t)pm_basis_features(b), sizeof *x->feature);
    x->stress = pm_arena_array(&r->arena, PM_BASIS_TENSOR * nnode, sizeof *x->stress);
    if (x->carries == NULL || x->feature == NULL || x->stress == NULL) {
        return no_memory();
    }
    PM_TRY(pm_local_find_sections(local, b->nnode, b->position, &b->arena));
    PM_TRY(pm_reduction_for_each(r, find_loaded, x));
    PM_TRY(pm_local_set_loaded(local, x->carries, r->how->reach, &b->arena));
    const size_t count = (size_t)pm_local_features(local), nsection = (size_t)local->nsection;
    x->local_feature = pm_arena_array(&r->arena, nsection * count, sizeof *x->local_feature);
    x->local_rest = pm_arena_array(&r->arena, PM_LOCAL_TENSOR * nnode, sizeof *x->local_rest);
    if (x->local_feature == NULL || x->local_rest == NULL) {
        return no_memory();
    }
    return pm_regression_open(&x->regression, (int)count, PM_LOCAL_TENSOR * local->nper);
}

static pm_status fit_local(pm_reduction *r, pm_basis *b) {
    local_fit x = {0};
    pm_status status;
    PM_TRY_DONE(open_local(r, b, &x));
    PM_TRY_DONE(pm_reduction_for_each(r, add_local, &x));
    PM_TRY_DONE(pm_regression_solve(&x.regression, PATTERN_RIDGE));
    memcpy(b->local.kernel, x.regression.cross,
           (size_t)x.regression.nfeature * (size_t)x.regression.nresult * sizeof *b->local.kernel);
    status = PM_OK;
done:
    pm_regression_close(&x.regression);
    return status;
}

// Patterns first; what they leave is local, where loads are; and then what that leaves.
pm_status pm_reduce_patterns(pm_reduction *r, pm_basis *basis) {
    PM_TRY(fit_patterns(r, basis));
    if (r->how->reach == 0 || r->path.stress == NULL) {
        return PM_OK;
    }
    PM_TRY(fit_local(r, basis));
    return fit_patterns(r, basis);
}
