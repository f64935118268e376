// Fits the remainder of the displacements, then stress pattern and local kernel in turn.
#include "modal/reduce_patterns.h"

#include <stdlib.h>
#include <string.h>

#include "modal/regression.h"

// Only every STRIDE-th state enters the local kernel, because neighbours in time are similar.
#define STRIDE 3
// The ridge of patterns is the square of the relative error that a predicted state is expected to
// have. The features are linearly dependent, and differences below this error carry no information.
#define PATTERN_RIDGE 1e-4
// Stress pattern and local kernel are fitted in turn, each to the residual of the other. After the
// first round each still contains much of the other; after the fourth round little changes.
#define ROUNDS 4

// --- patterns ---

// The regression of a field on the features.
typedef struct remainder_fit {
    const pm_basis *b;
    pm_regression regression;
    double *feature, *rest; // [ntime] rows
    double *work;           // pm_local_work numbers
} remainder_fit;

// Fills in the weighted features at all times of a trajectory.
static void fill_features(const remainder_fit *x, const pm_modal_trajectory *p, double weight) {
    const int count = pm_basis_features(x->b);
    double c[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_MODES];
    for (int j = 0; j < p->ntime; ++j) {
        pm_modal_state state;
        pm_modal_trajectory_state(p, x->b, j, c, &state);
        pm_basis_fill_features(x->b, &state, x->feature + (ptrdiff_t)j * count);
    }
    for (ptrdiff_t i = 0; i < (ptrdiff_t)p->ntime * count; ++i) {
        x->feature[i] *= weight;
    }
}

// Subtracts the modes of the state from the displacements at a time; the result is weighted.
static void subtract_modes(const pm_modal_trajectory *p, const pm_basis *b, int time, double weight,
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

static pm_status add_displacement(pm_reduction *r, double weight, void *context) {
    remainder_fit *x = context;
    const pm_modal_trajectory *p = &r->modal;
    const ptrdiff_t width = 3 * (ptrdiff_t)p->nnode;
    pm_modal_trajectory_project(&r->modal, x->b, r->field->dt);
    fill_features(x, p, weight);
    for (int j = 0; j < p->ntime; ++j) {
        subtract_modes(p, x->b, j, weight, x->rest + j * width);
    }
    pm_regression_add(&x->regression, p->ntime, x->feature, x->rest);
    return PM_OK;
}

// Subtracts the stress of the local kernel from the stress at a time; the result is weighted.
static void subtract_local(const pm_modal_trajectory *p, const remainder_fit *x, int time,
                           double weight) {
    const ptrdiff_t width = PM_BASIS_TENSOR * (ptrdiff_t)p->nnode, at = time * width;
    double *rest = x->rest + at;
    memset(rest, 0, (size_t)width * sizeof *rest);
    pm_local_add(&x->b->local, p->f + 3 * (ptrdiff_t)time * p->nnode, rest, x->work);
    for (ptrdiff_t i = 0; i < width; ++i) {
        rest[i] = weight * (p->stress[at + i] - rest[i]);
    }
}

// Returns the weight of the stress of a trajectory: one over its norm, so that its unit does not
// matter.
static double weigh_stress(const pm_modal_trajectory *p) {
    return 1 / pm_reduction_norm(PM_BASIS_TENSOR * (size_t)p->nnode * (size_t)p->ntime, p->stress);
}

static pm_status add_stress(pm_reduction *r, double weight, void *context) {
    (void)weight;
    remainder_fit *x = context;
    const pm_modal_trajectory *p = &r->modal;
    const double stressed = weigh_stress(p);
    pm_modal_trajectory_project(&r->modal, x->b, r->field->dt);
    fill_features(x, p, stressed);
    for (int j = 0; j < p->ntime; ++j) {
        subtract_local(p, x, j, stressed);
    }
    pm_regression_add(&x->regression, p->ntime, x->feature, x->rest);
    return PM_OK;
}

// Fits a pattern of `width` numbers to the samples that `add` adds. It replaces an earlier one.
static pm_status fit_pattern(pm_reduction *r, pm_basis *b, pm_reduction_visit *add, int width,
                             int rank, pm_pattern *pattern) {
    const int count = pm_basis_features(b), most = count < width ? count : width;
    const size_t ntime = (size_t)r->modal.ntime;
    remainder_fit x = {.b = b,
                       .feature = calloc(ntime * (size_t)count, sizeof(double)),
                       .rest = calloc(ntime * (size_t)width, sizeof(double)),
                       .work = calloc(pm_local_work(&b->local), sizeof(double))};
    pm_status status =
        x.feature == NULL || x.rest == NULL || x.work == NULL ? pm_reduction_no_memory() : PM_OK;
    PM_TRY_DONE(status);
    if (pattern->pattern == NULL) {
        PM_TRY_DONE(pm_basis_add_pattern(b, pattern, rank < most ? rank : most, width));
    }
    PM_TRY_DONE(pm_regression_open(&x.regression, count, width));
    PM_TRY_DONE(pm_reduction_for_each(r, add, &x));
    PM_TRY_DONE(pm_regression_solve(&x.regression, PATTERN_RIDGE));
    status = pm_regression_compress(&x.regression, pattern->rank, pattern->coefficient,
                                    pattern->pattern);
done:
    pm_regression_close(&x.regression);
    free(x.feature);
    free(x.rest);
    free(x.work);
    return status;
}

// --- the local kernel ---

// The regression of the stress of sections on the forces around them.
typedef struct local_fit {
    const pm_basis *b;
    pm_regression regression;
    int *carries;                       // [nnode]
    double *feature, *stress;           // at one time: features of the basis, and [nnode][6] Pa
    double *local_feature, *local_rest; // [nsection] rows
} local_fit;

// Marks the nodes that carry a load at any time.
static pm_status find_loaded(pm_reduction *r, double weight, void *context) {
    (void)weight;
    const local_fit *x = context;
    const pm_modal_trajectory *p = &r->modal;
    for (ptrdiff_t i = 0; i < 3 * (ptrdiff_t)p->ntime * p->nnode; ++i) {
        x->carries[i / 3 % p->nnode] |= p->f[i] != 0;
    }
    return PM_OK;
}

// Subtracts the stress pattern from the stress at a time.
static void subtract_pattern(const local_fit *x, const pm_modal_trajectory *p, int time) {
    const int width = PM_BASIS_TENSOR * p->nnode;
    double c[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_MODES];
    pm_modal_state state;
    pm_modal_trajectory_state(p, x->b, time, c, &state);
    pm_basis_fill_features(x->b, &state, x->feature);
    memset(x->stress, 0, (size_t)width * sizeof *x->stress);
    pm_pattern_add(&x->b->stress, pm_basis_features(x->b), x->feature, x->stress);
    for (int i = 0; i < width; ++i) {
        x->stress[i] = p->stress[(ptrdiff_t)time * width + i] - x->stress[i];
    }
}

static pm_status add_local(pm_reduction *r, double weight, void *context) {
    (void)weight;
    local_fit *x = context;
    const pm_modal_trajectory *p = &r->modal;
    const pm_local *local = &x->b->local;
    const int count = pm_local_features(local), width = PM_LOCAL_TENSOR * local->nper;
    const double scale = weigh_stress(p);
    pm_modal_trajectory_project(&r->modal, x->b, r->field->dt);
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
        return pm_reduction_no_memory();
    }
    PM_TRY(pm_local_find_sections(local, b->nnode, b->position, &b->arena));
    PM_TRY(pm_reduction_for_each(r, find_loaded, x));
    PM_TRY(pm_local_set_loaded(local, x->carries, r->settings->reach, &b->arena));
    const size_t count = (size_t)pm_local_features(local), nsection = (size_t)local->nsection;
    x->local_feature = pm_arena_array(&r->arena, nsection * count, sizeof *x->local_feature);
    x->local_rest = pm_arena_array(&r->arena, PM_LOCAL_TENSOR * nnode, sizeof *x->local_rest);
    return x->local_feature == NULL || x->local_rest == NULL ? pm_reduction_no_memory() : PM_OK;
}

static pm_status fit_kernel(pm_reduction *r, pm_basis *b, local_fit *x) {
    const int count = pm_local_features(&b->local), width = PM_LOCAL_TENSOR * b->local.nper;
    pm_status status;
    PM_TRY_DONE(pm_regression_open(&x->regression, count, width));
    PM_TRY_DONE(pm_reduction_for_each(r, add_local, x));
    PM_TRY_DONE(pm_regression_solve(&x->regression, PATTERN_RIDGE));
    memcpy(b->local.kernel, x->regression.cross,
           (size_t)count * (size_t)width * sizeof *b->local.kernel);
    status = PM_OK;
done:
    pm_regression_close(&x->regression);
    return status;
}

static pm_status fit_stress(pm_reduction *r, pm_basis *b) {
    return fit_pattern(r, b, add_stress, PM_BASIS_TENSOR * b->nnode, r->settings->stress_rank,
                       &b->stress);
}

// Rounds to single precision, which is far below the error of the patterns and halves the file.
static void round_numbers(size_t count, double *number) {
    for (size_t i = 0; i < count; ++i) {
        number[i] = (float)number[i];
    }
}

static void round_pattern(pm_pattern *p) {
    round_numbers((size_t)p->rank * (size_t)p->width, p->pattern);
}

static pm_status fit_all(pm_reduction *r, pm_basis *basis) {
    local_fit local = {0};
    PM_TRY(fit_pattern(r, basis, add_displacement, 3 * basis->nnode, r->settings->displacement_rank,
                       &basis->displacement));
    if (r->modal.stress == NULL) {
        return PM_OK;
    }
    PM_TRY(fit_stress(r, basis));
    if (r->settings->reach == 0) {
        return PM_OK;
    }
    PM_TRY(open_local(r, basis, &local));
    for (int i = 0; i < ROUNDS; ++i) {
        PM_TRY(fit_kernel(r, basis, &local));
        PM_TRY(fit_stress(r, basis));
    }
    return PM_OK;
}

pm_status pm_reduce_patterns(pm_reduction *r, pm_basis *basis) {
    PM_TRY(fit_all(r, basis));
    const pm_local *l = &basis->local;
    round_pattern(&basis->displacement);
    round_pattern(&basis->stress);
    round_numbers((size_t)pm_local_features(l) * (size_t)l->nper * PM_LOCAL_TENSOR, l->kernel);
    return PM_OK;
}
