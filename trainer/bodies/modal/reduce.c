// Adds up and solves normal equations, fits a basis in three steps, modes, creep and patterns, and
// projects fields on a basis.
#include "bodies/modal/reduce.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"

// Only every STRIDE-th state enters the decomposition and the local kernel, because neighbours in
// time are similar.
#define STRIDE 3
// The features of modes are linearly dependent, and the internal variables of branches with similar
// times nearly so. This ridge is just large enough to keep coefficients small that the data do not
// determine; a larger ridge would soften the modes.
#define RIDGE 1e-7
// A mode belongs to the state if its load is at least this fraction of its elastic force. For
// relaxed rubber a load of a fifth is in equilibrium with the elastic force. A mode with a smaller
// load is moved by other modes.
#define DRIVEN 0.25
// The smallest flexibility of a mode, relative to the softest one. For a nearly rigid mode the
// regression finds a flexibility of zero or less.
#define STIFFEST 1e-6
// The smallest share of the stiffness that remains when all branches have relaxed. Without it a
// fitted sum of shares of 1 would give an infinite time.
#define REMAINS 0.01
// The ridge of patterns is the square of the relative error that a predicted state is expected to
// have. The features are linearly dependent, and differences below this error carry no information.
#define PATTERN_RIDGE 1e-4
// Stress pattern and local kernel are fitted in turn, each to the residual of the other. After the
// first round each still contains much of the other; after the fourth round little changes.
#define ROUNDS 4
// A feature counts as zero if its mean square is below this fraction of the largest mean square.
// The rounding of a sum of n terms that cancel leaves about n^2 DBL_EPSILON^2, 5e-26 for a thousand
// terms, and its bits depend on the processor. The margin beyond that is a factor of 1e5.
#define NEVER 1e-20

// --- regressions ---

pm_status pm_regression_open(pm_regression *r, int nfeature, int nresult) {
    const size_t p = (size_t)nfeature, m = (size_t)nresult;
    *r = (pm_regression){
        .nfeature = nfeature,
        .nresult = nresult,
        .gram = calloc(p * p, sizeof(double)),
        .cross = calloc(p * m, sizeof(double)),
        .product = calloc(p * m, sizeof(double)),
    };
    if (r->gram == NULL || r->cross == NULL || r->product == NULL) {
        pm_regression_close(r);
        return pm_fail(PM_ENOMEM, "out of memory for a regression");
    }
    return PM_OK;
}

void pm_regression_close(pm_regression *r) {
    free(r->gram);
    free(r->cross);
    free(r->product);
    *r = (pm_regression){0};
}

void pm_regression_add(pm_regression *r, int count, const double *features, const double *results) {
    const size_t size = (size_t)r->nfeature * (size_t)r->nresult;
    pm_gram_add(count, r->nfeature, features, r->gram);
    pm_gemm(true, false, r->nfeature, r->nresult, count, features, results, r->product);
    for (size_t i = 0; i < size; ++i) {
        r->cross[i] += r->product[i];
    }
}

pm_status pm_regression_solve(pm_regression *r, double ridge) {
    const size_t p = (size_t)r->nfeature;
    double largest = 0;
    for (size_t i = 0; i < p; ++i) {
        largest = fmax(largest, r->gram[i * p + i]);
    }
    for (size_t i = 0; i < p; ++i) {
        double *diagonal = &r->gram[i * p + i];
        *diagonal = *diagonal > NEVER * largest ? *diagonal * (1 + ridge) : largest;
    }
    if (!pm_cholesky_factor(r->nfeature, r->gram)) {
        return pm_fail(PM_ENUMERIC, "a regression on %d features does not determine them",
                       r->nfeature);
    }
    pm_cholesky_back(r->nfeature, r->gram, r->nresult, r->cross);
    return PM_OK;
}

pm_status pm_regression_compress(const pm_regression *r, int rank, double *coefficient,
                                 double *pattern) {
    const int p = r->nfeature, m = r->nresult;
    const size_t n = (size_t)p, count = (size_t)m, nrank = (size_t)rank;
    pm_arena work = {0};
    double *u = pm_arena_array(&work, n * n, sizeof *u);
    double *square = pm_arena_array(&work, n * n, sizeof *square);
    double *product = pm_arena_array(&work, n * count, sizeof *product);
    double *vector = pm_arena_array(&work, nrank * n, sizeof *vector);
    double *value = pm_arena_array(&work, nrank, sizeof *value);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&work, "a regression"));
    // product = u cross, where gram = u^T u is the Cholesky factorization.
    for (size_t i = 0; i < n; ++i) {
        memcpy(u + i * n + i, r->gram + i * n + i, (n - i) * sizeof *u);
    }
    pm_gemm(false, false, p, m, p, u, r->cross, product);
    pm_gemm(false, true, p, p, m, product, product, square);
    if (!pm_eigen_largest(p, square, rank, value, vector)) {
        PM_TRY_DONE(pm_fail(PM_ENUMERIC, "no eigenvectors of a regression on %d features", p));
    }
    pm_gemm(false, false, rank, m, p, vector, product, pattern);
    // coefficient = u^-1 vector^T = (u^T u)^-1 u^T vector^T
    pm_gemm(true, true, p, rank, p, u, vector, coefficient);
    pm_cholesky_back(p, u, rank, coefficient);
done:
    pm_arena_free(&work);
    return status;
}

// The trajectories of a reduction, and the one that is being visited. Amplitudes and loads cover
// all modes, also those outside the state.
typedef struct reduction {
    const pm_field *field;
    int count;
    const int *trajectory; // [count]
    int ncopy;             // symmetric copies of each
    pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE];
    pm_load_kind loads;
    int ntime, nmode, nbranch, nnode;
    int q, sigma;    // indices of the field's variables qx and sxx; -1: the field has none
    double *u;       // [ntime][nnode][3] m, displacements
    double *f;       // [ntime][nnode][3] N, loads; zero on nodes that never move
    double *stress;  // [ntime][nnode][6] Pa, or NULL
    double *a;       // [ntime][nmode] J^0.5
    double *load;    // [ntime][nmode] J^0.5
    double *c;       // [nbranch][ntime][nmode] J^0.5
    double *delayed; // [ntime][nretardation of the basis][nmode] J^0.5
    double *moved;   // [nnode][3] work space
    pm_arena arena;  // owns the arrays
} reduction;

// --- trajectories ---

// Makes the symmetric copies (`square`: all eight) and room for one trajectory, with `stress` also
// for its stress if the field has it. The caller sets `field`, `count` and `trajectory` first, and
// frees the arena, after a failure too.
static pm_status open_reduction(reduction *r, int nmode, int nbranch, bool square,
                                pm_load_kind loads, bool stress) {
    const pm_field *field = r->field;
    const size_t ntime = (size_t)field->ntime, width = 3 * (size_t)field->nnode;
    const size_t history = ((size_t)nbranch * ntime + 1) * (size_t)nmode;
    pm_arena *arena = &r->arena;
    r->ncopy = square ? PM_SYMMETRY_COPIES_OF_SQUARE : 1;
    PM_TRY(square ? pm_symmetry_copies_make(r->copy, field, arena)
                  : pm_symmetry_copies_none(&r->copy[0], field, arena));
    r->loads = loads;
    r->ntime = field->ntime;
    r->nmode = nmode;
    r->nbranch = nbranch;
    r->nnode = field->nnode;
    r->q = pm_field_columns(field, "qx qy qz");
    r->sigma = stress ? pm_field_columns(field, "sxx syy szz sxy sxz syz") : -1;
    if (r->q < 0) {
        return pm_fail(PM_EDATA, "the field has no positions \"qx qy qz\" among \"%s\"",
                       field->variable);
    }
    r->u = pm_arena_array(arena, ntime * width, sizeof *r->u);
    r->f = pm_arena_array(arena, ntime * width, sizeof *r->f);
    r->a = pm_arena_array(arena, ntime * (size_t)nmode, sizeof *r->a);
    r->load = pm_arena_array(arena, ntime * (size_t)nmode, sizeof *r->load);
    r->c = pm_arena_array(arena, history, sizeof *r->c);
    r->delayed = pm_arena_array(arena, history, sizeof *r->delayed);
    r->moved = pm_arena_array(arena, width, sizeof *r->moved);
    if (r->sigma >= 0) {
        r->stress = pm_arena_array(arena, 2 * ntime * width, sizeof *r->stress);
    }
    return pm_arena_status(arena, "a body's trajectory");
}

// Reads displacements, loads and, if there is room, stress of a symmetric copy of a trajectory.
static void read_copy(reduction *r, int trajectory, const pm_copy *copy) {
    const pm_field *field = r->field;
    const ptrdiff_t width = 3 * (ptrdiff_t)r->nnode;
    for (int j = 0; j < r->ntime; ++j) {
        const double *state = pm_field_state(field, trajectory, j);
        double *f = r->f + j * width;
        // Displacements are computed before they are copied, since a copy of positions would move
        // their origin.
        for (int i = 0; i < r->nnode; ++i) {
            const double *q = state + (ptrdiff_t)i * field->nvariable + r->q;
            for (int d = 0; d < 3; ++d) {
                r->moved[3 * i + d] = q[d] - field->position[3 * i + d];
            }
        }
        pm_copy_vectors(copy, r->nnode, r->moved, 3, r->u + j * width);
        pm_copy_vectors(copy, r->nnode, pm_field_force(field, trajectory, j), 3, f);
        if (r->loads == PM_LOADS_OF_ALL && field->contact != NULL) {
            pm_copy_vectors(copy, r->nnode, pm_field_contact(field, trajectory, j), 3, r->moved);
            for (int i = 0; i < width; ++i) {
                f[i] += r->moved[i];
            }
        }
        if (r->stress != NULL) {
            pm_copy_tensors(copy, r->nnode, state + r->sigma, field->nvariable,
                            r->stress + 2 * j * width);
        }
    }
    // Loads on clamped nodes have no effect. A node is taken to be clamped if it never moves.
    for (int i = 0; i < r->nnode; ++i) {
        bool moves = false;
        for (int j = 0; j < r->ntime && !moves; ++j) {
            const double *u = r->u + 3 * ((ptrdiff_t)j * r->nnode + i);
            moves = u[0] != 0 || u[1] != 0 || u[2] != 0;
        }
        for (int j = 0; j < r->ntime && !moves; ++j) {
            memset(r->f + 3 * ((ptrdiff_t)j * r->nnode + i), 0, 3 * sizeof *r->f);
        }
    }
}

// Returns the Euclidean norm of value [count].
static double norm(size_t count, const double *value) {
    double sum = 0;
    for (size_t i = 0; i < count; ++i) {
        sum += value[i] * value[i];
    }
    return sqrt(sum);
}

// Reads the next symmetric copy of a trajectory in which the body moves; returns false when there
// is none. `at` begins with 0 and counts the copies. `weight` is one over the norm of the
// displacements, so that all trajectories count equally.
static bool next_copy(reduction *r, int *at, double *weight) {
    while (*at < r->count * r->ncopy) {
        const int i = (*at)++;
        read_copy(r, r->trajectory[i / r->ncopy], &r->copy[i % r->ncopy]);
        const double size = norm(3 * (size_t)r->nnode * (size_t)r->ntime, r->u);
        if (size > 0) {
            *weight = 1 / size;
            return true;
        }
    }
    return false;
}

// Integrates dy/dt = (x - y)/tau for x [ntime][nmode]. The values y at successive times are
// `stride` numbers apart.
static void integrate(const reduction *r, const double *x, double tau, double dt, int stride,
                      double *y) {
    const size_t row = (size_t)r->nmode * sizeof *y;
    memcpy(y, x, row);
    for (int j = 1; j < r->ntime; ++j, x += r->nmode, y += stride) {
        memcpy(y + stride, y, row);
        pm_basis_relax(r->nmode, tau, dt, x, x + r->nmode, y + stride);
    }
}

// Computes a, load, c and the delayed loads from the displacements u and the loads f of the
// trajectory that was read last, with the modes and times of the basis. The internal variables c
// solve dc_k/dt = (a - c_k)/tau_k exactly for an amplitude a that is linear in time between two
// states. They start at c_k = a, as if a had been constant before the first state. The same holds
// for the delayed loads and the loads.
static void project(reduction *r, const pm_basis *basis) {
    const int width = 3 * r->nnode;
    pm_gemm(false, true, r->ntime, r->nmode, width, r->u, basis->mode, r->a);
    pm_gemm(false, true, r->ntime, r->nmode, width, r->f, basis->mode, r->load);
    for (int j = 0; j < r->ntime; ++j) {
        for (int i = 0; i < r->nmode; ++i) {
            r->a[(ptrdiff_t)j * r->nmode + i] *= basis->stiffness[i];
        }
    }
    for (int k = 0; k < r->nbranch; ++k) {
        integrate(r, r->a, basis->tau[k], r->field->dt, r->nmode,
                  r->c + (ptrdiff_t)k * r->ntime * r->nmode);
    }
    for (int k = 0; k < basis->nretardation; ++k) {
        integrate(r, r->load, basis->retardation[k], r->field->dt, basis->nretardation * r->nmode,
                  r->delayed + (ptrdiff_t)k * r->nmode);
    }
}

// Writes the modal state at time number `time`, for the modes of the basis's state, to `state`.
// `c` [nbranch][nstate] is memory of the caller, which must outlive the state.
static void take_state(const reduction *r, const pm_basis *b, int time, double *c,
                       pm_modal_state *state) {
    const ptrdiff_t at = (ptrdiff_t)time * r->nmode;
    for (int k = 0; k < b->nbranch; ++k) {
        memcpy(c + (ptrdiff_t)k * b->nstate, r->c + (ptrdiff_t)k * r->ntime * r->nmode + at,
               (size_t)b->nstate * sizeof *c);
    }
    *state = (pm_modal_state){
        .a = r->a + at, .c = c, .load = r->load + at, .delayed = r->delayed + at * b->nretardation};
}

// --- the first step: modes, their stiffness, and the constants of the basis ---

// Makes the modes orthonormal eigenvectors of the displacements.
static pm_status decompose(reduction *r, pm_basis *b) {
    const int width = 3 * r->nnode;
    pm_arena work = {0};
    double *gram = pm_arena_array(&work, (size_t)width * (size_t)width, sizeof *gram);
    double *row = pm_arena_array(&work, (size_t)r->ntime * (size_t)width, sizeof *row);
    double *value = pm_arena_array(&work, (size_t)b->nmode, sizeof *value), weight;
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&work, "a reduction"));
    for (int at = 0; next_copy(r, &at, &weight);) {
        int count = 0;
        for (int j = STRIDE - 1; j < r->ntime; j += STRIDE, ++count) {
            for (int i = 0; i < width; ++i) {
                row[(ptrdiff_t)count * width + i] = weight * r->u[(ptrdiff_t)j * width + i];
            }
        }
        pm_gram_add(count, width, row, gram);
    }
    if (!pm_eigen_largest(width, gram, b->nmode, value, b->mode)) {
        status = pm_fail(PM_ENUMERIC, "no modes of the displacements");
    }
    for (int i = 0; i < b->nmode; ++i) {
        b->stiffness[i] = 1;
    }
done:
    pm_arena_free(&work);
    return status;
}

// Finds the largest leading amplitudes.
static void find_lead_scale(reduction *r, pm_basis *b) {
    double weight;
    for (int at = 0; next_copy(r, &at, &weight);) {
        project(r, b);
        for (int j = 0; j < r->ntime; ++j) {
            for (int i = 0; i < b->nlead; ++i) {
                const double size = fabs(r->a[(ptrdiff_t)j * r->nmode + i]);
                b->lead_scale[i] = fmax(b->lead_scale[i], size);
            }
        }
    }
}

// Fits the flexibility da/d(load) of the first `turned` modes by a regression of their amplitudes
// on all features but amplitudes and the loads of the other modes: internal variables, loads and
// products. Rotates them to the eigenvectors of its symmetric part, and scales them as basis.h
// says. The other modes are scaled by their amplitudes under their own loads.
static pm_status rotate_modes(reduction *r, pm_basis *b, int turned) {
    const int n = b->nmode, count = pm_basis_features(b), used = count - 2 * n + turned;
    const int first = b->nbranch * n; // of the loads, behind the internal variables
    const size_t ntime = (size_t)r->ntime, width = 3 * (size_t)b->nnode;
    double c[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_MODES], weight;
    double work_done[PM_BASIS_MAX_MODES] = {0}, loads[PM_BASIS_MAX_MODES] = {0};
    pm_arena work = {0};
    pm_regression regression = {0};
    double *all = pm_arena_array(&work, (size_t)count, sizeof *all);
    double *feature = pm_arena_array(&work, ntime * (size_t)count, sizeof *feature);
    double *result = pm_arena_array(&work, ntime * (size_t)turned, sizeof *result);
    double *square = pm_arena_array(&work, (size_t)(turned * turned), sizeof *square);
    double *vector = pm_arena_array(&work, (size_t)(turned * turned), sizeof *vector);
    double *value = pm_arena_array(&work, (size_t)turned, sizeof *value);
    double *mode = pm_arena_array(&work, (size_t)n * width, sizeof *mode);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&work, "a reduction"));
    PM_TRY_DONE(pm_regression_open(&regression, used, turned));
    find_lead_scale(r, b);
    for (int at = 0; next_copy(r, &at, &weight);) {
        project(r, b);
        for (int j = 0; j < r->ntime; ++j) {
            pm_modal_state state;
            take_state(r, b, j, c, &state);
            pm_basis_fill_features(b, &state, all);
            for (int i = 0; i < used; ++i) {
                const int from = n + i + (i < first + turned ? 0 : n - turned);
                feature[(ptrdiff_t)j * used + i] = weight * all[from];
            }
            for (int i = 0; i < turned; ++i) {
                result[(ptrdiff_t)j * turned + i] = weight * state.a[i];
            }
            for (int i = turned; i < n; ++i) {
                work_done[i] += weight * weight * state.a[i] * state.load[i];
                loads[i] += weight * weight * state.load[i] * state.load[i];
            }
        }
        pm_regression_add(&regression, r->ntime, feature, result);
    }
    PM_TRY_DONE(pm_regression_solve(&regression, RIDGE));
    // All modes have stiffness 1 here.
    const double *cross = regression.cross + (ptrdiff_t)first * turned;
    for (int i = 0; i < turned; ++i) {
        for (int j = 0; j < turned; ++j) {
            square[i * turned + j] = 0.5 * (cross[i * turned + j] + cross[j * turned + i]);
        }
    }
    if (!pm_eigen_largest(turned, square, turned, value, vector)) {
        PM_TRY_DONE(pm_fail(PM_ENUMERIC, "no eigenvectors of the flexibility"));
    }
    memcpy(mode, b->mode, (size_t)n * width * sizeof *mode);
    pm_gemm(false, false, turned, (int)width, turned, vector, b->mode, mode);
    for (size_t i = 0; i < (size_t)n; ++i) {
        const double own = i < (size_t)turned ? value[i] : work_done[i] / fmax(loads[i], DBL_MIN);
        const double softness = fmax(own, STIFFEST * value[0]);
        b->stiffness[i] = 1 / softness;
        for (size_t k = 0; k < width; ++k) {
            b->mode[i * width + k] = sqrt(softness) * mode[i * width + k];
        }
    }
done:
    pm_regression_close(&regression);
    pm_arena_free(&work);
    return status;
}

// Orders the modes: first those that carry the energy, at most `most`, softest first; then the
// others, the first `turned` before the rest, by the work of the loads on them, a measure of which
// is the product of both sums of squares. Returns the number of modes that carry the energy.
// `order` is [2 nmode].
static int order_modes(reduction *r, const pm_basis *b, int most, int turned, int *order) {
    double loads[PM_BASIS_MAX_MODES] = {0}, amplitudes[PM_BASIS_MAX_MODES] = {0}, weight;
    const int n = b->nmode;
    int count = 0, rest = 0, *other = order + n;
    // The squares are not weighted, because modes accompany others most at large deflections.
    for (int at = 0; next_copy(r, &at, &weight);) {
        project(r, b);
        for (int j = 0; j < r->ntime; ++j) {
            for (int i = 0; i < n; ++i) {
                const double a = r->a[(ptrdiff_t)j * n + i], load = r->load[(ptrdiff_t)j * n + i];
                amplitudes[i] += a * a;
                loads[i] += load * load;
            }
        }
    }
    for (int i = 0; i < n; ++i) {
        const bool driven = loads[i] > DRIVEN * DRIVEN * amplitudes[i];
        const double work = amplitudes[i] * loads[i];
        if (driven && count < most) {
            order[count++] = i;
            continue;
        }
        int at = rest++;
        for (; at > 0 && (i < turned || other[at - 1] >= turned) &&
               amplitudes[other[at - 1]] * loads[other[at - 1]] < work;
             --at) {
            other[at] = other[at - 1];
        }
        other[at] = i;
    }
    memcpy(order + count, other, (size_t)rest * sizeof *order);
    return count;
}

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

// Makes a basis with its modes. The caller frees it, after a failure too.
static pm_status find_modes(reduction *r, const pm_reduce_settings *settings, pm_basis **basis) {
    const int n = settings->nmode, most = settings->nlead < n ? settings->nlead : n;
    const int turned = settings->nturned > 0 ? settings->nturned : n;
    const size_t width = 3 * (size_t)r->nnode;
    int order[2 * PM_BASIS_MAX_MODES];
    pm_basis *all = NULL;
    pm_status status;
    PM_TRY_DONE(pm_basis_new(&all, r->nnode, n, n, most));
    PM_TRY_DONE(set_constants(all, settings, r->field));
    PM_TRY_DONE(decompose(r, all));
    PM_TRY_DONE(rotate_modes(r, all, turned));
    const int nstate = order_modes(r, all, settings->nstate, turned, order);
    if (nstate == 0) {
        PM_TRY_DONE(pm_fail(PM_EDATA, "no mode of the displacements follows the loads"));
    }
    PM_TRY_DONE(pm_basis_new(basis, r->nnode, n, nstate,
                             nstate < settings->nlead ? nstate : settings->nlead));
    PM_TRY_DONE(set_constants(*basis, settings, r->field));
    for (int i = 0; i < n; ++i) {
        memcpy((*basis)->mode + (size_t)i * width, all->mode + (size_t)order[i] * width,
               width * sizeof *all->mode);
        (*basis)->stiffness[i] = all->stiffness[order[i]];
    }
    find_lead_scale(r, *basis);
done:
    pm_basis_free(all);
    return status;
}

// --- the second step: the times with which the body creeps under a constant load ---

// Sets the retardation times of a basis whose modes and relaxation times are known, one for each
// branch. A small load on a mode is in balance with
//     load = a - sum_k share_k c_k,     dc_k/dt = (a - c_k)/tau_k.
// The shares of the branches are fitted to the amplitudes of the state by least squares. The
// solution of these equations for a constant load is a sum of exponential functions, whose times
// are the eigenvalues of the symmetric matrix
//     delta_kl tau_k + sqrt(share_k tau_k share_l tau_l) / (1 - sum of all shares).
// Source: Tschoegl, The Phenomenological Theory of Linear Viscoelastic Behavior, Springer 1989,
// chapter 3; the matrix is the inverse of that of the rates, by the formula of Sherman and
// Morrison. A basis without relaxation times has no retardation times.
static pm_status find_creep(reduction *r, pm_basis *b) {
    const int n = b->nstate, nbranch = b->nbranch, nrow = r->ntime * n;
    double square[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_BRANCHES];
    double vector[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_BRANCHES], remains = 1, weight;
    pm_arena work = {0};
    pm_regression regression = {0};
    // The internal variables [ntime * nstate][nbranch], J^0.5, and amplitudes less loads.
    double *c = pm_arena_array(&work, (size_t)nrow * (size_t)nbranch + 1, sizeof *c);
    double *rest = pm_arena_array(&work, (size_t)nrow, sizeof *rest);
    pm_status status = pm_arena_status(&work, "a reduction");
    if (status != PM_OK || nbranch == 0) {
        goto done;
    }
    PM_TRY_DONE(pm_regression_open(&regression, nbranch, 1));
    for (int i = 0; next_copy(r, &i, &weight);) {
        project(r, b);
        for (int row = 0; row < nrow; ++row) {
            const ptrdiff_t at = (ptrdiff_t)(row / n) * r->nmode + row % n;
            rest[row] = weight * (r->a[at] - r->load[at]);
            for (int k = 0; k < nbranch; ++k) {
                c[row * nbranch + k] = weight * r->c[(ptrdiff_t)k * r->ntime * r->nmode + at];
            }
        }
        pm_regression_add(&regression, nrow, c, rest);
    }
    PM_TRY_DONE(pm_regression_solve(&regression, RIDGE));
    double *share = regression.cross; // [nbranch]
    for (int k = 0; k < nbranch; ++k) {
        share[k] = fmax(share[k], 0);
        remains -= share[k];
    }
    for (int k = 0; k < nbranch; ++k) {
        for (int l = 0; l < nbranch; ++l) {
            square[k * nbranch + l] =
                sqrt(share[k] * b->tau[k] * share[l] * b->tau[l]) / fmax(remains, REMAINS) +
                (k == l ? b->tau[k] : 0);
        }
    }
    if (!pm_eigen_largest(nbranch, square, nbranch, b->retardation, vector)) {
        PM_TRY_DONE(pm_fail(PM_ENUMERIC, "no retardation times for %d relaxation times", nbranch));
    }
    b->nretardation = nbranch;
done:
    pm_regression_close(&regression);
    pm_arena_free(&work);
    return status;
}

// --- the third step: functions of the features of a state ---

// Returns the weight of the stress of a trajectory: one over its norm, so that its unit does not
// matter.
static double weigh_stress(const reduction *r) {
    return 1 / norm(PM_BASIS_TENSOR * (size_t)r->nnode * (size_t)r->ntime, r->stress);
}

// Fits the pattern of the stress less the convolution with the local kernel (`stress`), or of the
// remainder of the displacements, which the modes of the state leave. It replaces an earlier one.
static pm_status fit_pattern(reduction *r, pm_basis *b, bool stress, int rank,
                             pm_pattern *pattern) {
    const int count = pm_basis_features(b);
    const int width = (stress ? PM_BASIS_TENSOR : 3) * r->nnode;
    const int most = count < width ? count : width;
    const size_t ntime = (size_t)r->ntime;
    double c[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_MODES], weight;
    pm_arena work = {0};
    pm_regression regression = {0};
    double *feature = pm_arena_array(&work, ntime * (size_t)count, sizeof *feature);
    double *remainder = pm_arena_array(&work, ntime * (size_t)width, sizeof *remainder);
    double *local = pm_arena_array(&work, pm_local_work(&b->local), sizeof *local);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&work, "a reduction"));
    if (pattern->pattern == NULL) {
        PM_TRY_DONE(pm_basis_add_pattern(b, pattern, rank < most ? rank : most, width));
    }
    PM_TRY_DONE(pm_regression_open(&regression, count, width));
    for (int at = 0; next_copy(r, &at, &weight);) {
        weight = stress ? weigh_stress(r) : weight;
        project(r, b);
        for (int j = 0; j < r->ntime; ++j) {
            pm_modal_state state;
            take_state(r, b, j, c, &state);
            pm_basis_fill_features(b, &state, feature + (ptrdiff_t)j * count);
        }
        for (ptrdiff_t i = 0; i < (ptrdiff_t)r->ntime * count; ++i) {
            feature[i] *= weight;
        }
        for (int j = 0; j < r->ntime; ++j) {
            const double *a = r->a + (ptrdiff_t)j * r->nmode;
            const double *whole = (stress ? r->stress : r->u) + (ptrdiff_t)j * width;
            double *rest = remainder + (ptrdiff_t)j * width;
            memset(rest, 0, (size_t)width * sizeof *rest);
            if (stress) {
                pm_local_add(&b->local, r->f + 3 * (ptrdiff_t)j * r->nnode, rest, local);
            }
            for (int k = 0; k < width; ++k) {
                rest[k] = weight * (stress ? whole[k] - rest[k] : whole[k]);
            }
            for (int i = 0; i < b->nstate && !stress; ++i) {
                for (int k = 0; k < width; ++k) {
                    rest[k] -= weight * a[i] * b->mode[(ptrdiff_t)i * width + k];
                }
            }
        }
        pm_regression_add(&regression, r->ntime, feature, remainder);
    }
    PM_TRY_DONE(pm_regression_solve(&regression, PATTERN_RIDGE));
    status =
        pm_regression_compress(&regression, pattern->rank, pattern->coefficient, pattern->pattern);
done:
    pm_regression_close(&regression);
    pm_arena_free(&work);
    return status;
}

// Makes a local kernel of zeros for the nodes that carry a load at any time.
static pm_status make_kernel(reduction *r, pm_basis *b, int reach) {
    int *carries = pm_arena_array(&r->arena, (size_t)b->nnode, sizeof *carries);
    double weight;
    PM_TRY(pm_arena_status(&r->arena, "a reduction"));
    PM_TRY(pm_local_find_sections(&b->local, b->nnode, b->position, &b->arena));
    for (int at = 0; next_copy(r, &at, &weight);) {
        for (ptrdiff_t i = 0; i < 3 * (ptrdiff_t)r->ntime * r->nnode; ++i) {
            carries[i / 3 % r->nnode] |= r->f[i] != 0;
        }
    }
    return pm_local_set_loaded(&b->local, carries, reach, &b->arena);
}

// Fits the local kernel to the stress of sections less the stress pattern.
static pm_status fit_kernel(reduction *r, pm_basis *b) {
    const pm_local *local = &b->local;
    const int count = pm_local_features(local), width = PM_LOCAL_TENSOR * local->nper;
    const int nstress = PM_BASIS_TENSOR * r->nnode, nfeature = pm_basis_features(b);
    double c[PM_BASIS_MAX_BRANCHES * PM_BASIS_MAX_MODES], weight;
    pm_arena work = {0};
    pm_regression regression = {0};
    double *feature = pm_arena_array(&work, (size_t)nfeature, sizeof *feature);
    double *stress = pm_arena_array(&work, (size_t)nstress, sizeof *stress);
    double *row = pm_arena_array(&work, (size_t)local->nsection * (size_t)count, sizeof *row);
    double *rest = pm_arena_array(&work, (size_t)nstress, sizeof *rest);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&work, "a reduction"));
    PM_TRY_DONE(pm_regression_open(&regression, count, width));
    for (int at = 0; next_copy(r, &at, &weight);) {
        weight = weigh_stress(r);
        project(r, b);
        for (int j = STRIDE - 1; j < r->ntime; j += STRIDE) {
            pm_modal_state state;
            take_state(r, b, j, c, &state);
            pm_basis_fill_features(b, &state, feature);
            memset(stress, 0, (size_t)nstress * sizeof *stress);
            pm_pattern_add(&b->stress, nfeature, feature, stress);
            for (int i = 0; i < nstress; ++i) {
                stress[i] = r->stress[(ptrdiff_t)j * nstress + i] - stress[i];
            }
            for (int k = 0; k < local->nsection; ++k) {
                double *of_section = row + (ptrdiff_t)k * count;
                pm_local_fill_features(local, r->f + 3 * (ptrdiff_t)j * r->nnode, k, of_section);
                for (int i = 0; i < count; ++i) {
                    of_section[i] *= weight;
                }
                for (int i = 0; i < width; ++i) {
                    const int node = local->node[k * local->nper + i / PM_LOCAL_TENSOR];
                    rest[(ptrdiff_t)k * width + i] =
                        weight * stress[PM_LOCAL_TENSOR * node + i % PM_LOCAL_TENSOR];
                }
            }
            pm_regression_add(&regression, local->nsection, row, rest);
        }
    }
    PM_TRY_DONE(pm_regression_solve(&regression, PATTERN_RIDGE));
    memcpy(local->kernel, regression.cross, (size_t)count * (size_t)width * sizeof *local->kernel);
done:
    pm_regression_close(&regression);
    pm_arena_free(&work);
    return status;
}

// Rounds to single precision, which is far below the error of the patterns and halves the file.
static void round_numbers(size_t count, double *number) {
    for (size_t i = 0; i < count; ++i) {
        number[i] = (float)number[i];
    }
}

// Fits the remaining parts of a basis whose modes are known. The stress is the sum of the stress
// pattern and the convolution with the kernel, which are fitted in turn.
static pm_status find_patterns(reduction *r, const pm_reduce_settings *settings, pm_basis *b) {
    pm_pattern *u = &b->displacement, *sigma = &b->stress;
    const pm_local *l = &b->local;
    PM_TRY(fit_pattern(r, b, false, settings->displacement_rank, u));
    if (r->stress != NULL) {
        PM_TRY(fit_pattern(r, b, true, settings->stress_rank, sigma));
    }
    if (r->stress != NULL && settings->reach > 0) {
        PM_TRY(make_kernel(r, b, settings->reach));
        for (int i = 0; i < ROUNDS; ++i) {
            PM_TRY(fit_kernel(r, b));
            PM_TRY(fit_pattern(r, b, true, settings->stress_rank, sigma));
        }
    }
    round_numbers((size_t)u->rank * (size_t)u->width, u->pattern);
    round_numbers((size_t)sigma->rank * (size_t)sigma->width, sigma->pattern);
    round_numbers((size_t)pm_local_features(l) * (size_t)l->nper * PM_LOCAL_TENSOR, l->kernel);
    return PM_OK;
}

pm_status pm_reduce_fit(pm_basis **basis, const pm_field *field, int count, const int *trajectory,
                        const pm_reduce_settings *settings) {
    reduction r = {.field = field, .count = count, .trajectory = trajectory};
    pm_basis *b = NULL;
    pm_status status;
    assert(settings->nmode <= PM_BASIS_MAX_MODES && settings->nbranch <= PM_BASIS_MAX_BRANCHES);
    PM_TRY_DONE(open_reduction(&r, settings->nmode, settings->nbranch, settings->square,
                               PM_LOADS_OF_ALL, true));
    PM_TRY_DONE(find_modes(&r, settings, &b));
    PM_TRY_DONE(find_creep(&r, b));
    PM_TRY_DONE(find_patterns(&r, settings, b));
    *basis = b;
    b = NULL;
done:
    pm_basis_free(b);
    pm_arena_free(&r.arena);
    return status;
}

// --- projection ---

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
static void write_row(const reduction *p, const pm_basis *b, double dt, const double *dissipated,
                      int j, double *z, double *zdot) {
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
    reduction r = {.field = field};
    const int ncolumn = (2 + basis->nbranch) * basis->nstate + 1 + basis->nmode;
    int at = 0;
    pm_dataset *d = NULL;
    pm_status status;
    if (field->nnode != basis->nnode) {
        return pm_fail(PM_EDATA, "the field has %d nodes, the basis %d", field->nnode,
                       basis->nnode);
    }
    PM_TRY_DONE(open_reduction(&r, basis->nmode, basis->nbranch, square, loads, false));
    const char **name = pm_arena_array(&r.arena, (size_t)ncolumn, sizeof *name);
    PM_TRY_DONE(pm_arena_status(&r.arena, "the names of columns"));
    for (int g = 0; g < 2; ++g) {
        for (int i = 0; i < basis->nstate; ++i) {
            name[at++] = pm_arena_printf(&r.arena, "%c%d", "ap"[g], i);
        }
    }
    for (int k = 0; k < basis->nbranch; ++k) {
        for (int i = 0; i < basis->nstate; ++i) {
            name[at++] = pm_arena_printf(&r.arena, "c%d_%d", k, i);
        }
    }
    name[at++] = "s";
    for (int i = 0; i < basis->nmode; ++i) {
        name[at++] = i < basis->nstate ? pm_arena_printf(&r.arena, "f%d", i)
                                       : pm_arena_printf(&r.arena, "h%d", i - basis->nstate);
    }
    PM_TRY_DONE(pm_arena_status(&r.arena, "the names of columns"));
    PM_TRY_DONE(pm_dataset_new(&d, count * r.ncopy, field->ntime, ncolumn, field->dt, name));
    PM_TRY_DONE(pm_dataset_with_rates(d));
    for (int i = 0; i < d->ntrajectory; ++i) {
        const int from = trajectory[i / r.ncopy];
        read_copy(&r, from, &r.copy[i % r.ncopy]);
        project(&r, basis);
        const double *dissipated =
            field->energy == NULL
                ? NULL
                : field->energy + (ptrdiff_t)from * field->ntime * PM_FIELD_ENERGIES + 1;
        for (int j = 0; j < d->ntime; ++j) {
            write_row(&r, basis, field->dt, dissipated, j, pm_dataset_state(d, i, j),
                      pm_dataset_rate(d, i, j));
        }
    }
    *dataset = d;
    d = NULL;
done:
    pm_dataset_free(d);
    pm_arena_free(&r.arena);
    return status;
}
