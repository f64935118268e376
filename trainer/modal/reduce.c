// Modes by proper orthogonal decomposition, turned to the eigenvectors of the flexibility that a
// regression finds; patterns for all that the state's modes leave.
#include "modal/reduce.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "modal/path.h"
#include "modal/regression.h"

// Every so many states count in the decomposition: neighbours in time are alike.
#define STRIDE 3
#define RIDGE 1e-7
// That of patterns is the square of how far off, relatively, a predicted state is taken to be: the
// features depend on each other, and what tells them apart must not be taken for true.
#define PATTERN_RIDGE 1e-4
// A mode belongs to the state if its load is at least this share of what would hold it: relaxed
// rubber takes a fifth. Modes with less are carried along by others.
#define DRIVEN 0.25
// Softer than this relative to the softest mode a direction is taken to be rigid.
#define STIFFEST 1e-6

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a reduction");
}

// What is at hand while a basis is made.
typedef struct reduction {
    const pm_field *field;
    const pm_reduce_how *how;
    int count;
    const int *trajectory; // [count]
    int ncopy;
    pm_copy copy[PM_COPIES_OF_SQUARE];
    pm_path path;
    pm_arena arena;
} reduction;

static double norm(size_t count, const double *value) {
    double sum = 0;
    for (size_t i = 0; i < count; ++i) {
        sum += value[i] * value[i];
    }
    return sqrt(sum);
}

// Calls visit with every trajectory and copy in r->path, and what makes it count as much as any.
typedef pm_status visit_path(reduction *r, double weight, void *context);
static pm_status for_each(reduction *r, visit_path *visit, void *context) {
    pm_path *p = &r->path;
    for (int i = 0; i < r->count; ++i) {
        for (int k = 0; k < r->ncopy; ++k) {
            pm_path_take(p, r->field, r->trajectory[i], &r->copy[k]);
            const double size = norm(3 * (size_t)p->nnode * (size_t)p->ntime, p->u);
            if (size > 0) {
                PM_TRY(visit(r, 1 / size, context));
            }
        }
    }
    return PM_OK;
}

// --- proper orthogonal decomposition ---

typedef struct decomposition {
    double *gram; // [3 nnode][3 nnode]
    double *row;  // [ntime / STRIDE][3 nnode]
} decomposition;

static pm_status add_snapshots(reduction *r, double weight, void *context) {
    const decomposition *d = context;
    const int width = 3 * r->path.nnode;
    int count = 0;
    for (int j = STRIDE - 1; j < r->path.ntime; j += STRIDE, ++count) {
        for (int i = 0; i < width; ++i) {
            d->row[(ptrdiff_t)count * width + i] = weight * r->path.u[(ptrdiff_t)j * width + i];
        }
    }
    pm_gram_add(count, width, d->row, d->gram);
    return PM_OK;
}

// Orthonormal modes of the displacements.
static pm_status decompose(reduction *r, pm_basis *b) {
    const size_t width = 3 * (size_t)r->field->nnode;
    decomposition d = {calloc(width * width, sizeof(double)),
                       calloc((size_t)r->path.ntime * width, sizeof(double))};
    double *value = calloc((size_t)b->nmode, sizeof *value);
    pm_status status = d.gram == NULL || d.row == NULL || value == NULL ? no_memory() : PM_OK;
    if (status == PM_OK) {
        status = for_each(r, add_snapshots, &d);
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

// Features of the regression: loads, what is remembered, and products; that is all features but a.
typedef struct flexibility {
    pm_basis *b;
    pm_regression regression;
    double *all, *feature, *result; // [ntime] rows
    double *loads, *amplitudes;     // [nmode] sums of squares
} flexibility;

static void read_path(const pm_path *p, const pm_basis *b, int time, double *c, pm_reading *r) {
    const ptrdiff_t at = (ptrdiff_t)time * p->nmode;
    for (int k = 0; k < b->nbranch; ++k) {
        memcpy(c + (ptrdiff_t)k * b->nstate, p->c + (ptrdiff_t)k * p->ntime * p->nmode + at,
               (size_t)b->nstate * sizeof *c);
    }
    *r = (pm_reading){.a = p->a + at, .c = c, .load = p->load + at};
}

static pm_status find_lead_scale(reduction *r, double weight, void *context) {
    (void)weight;
    pm_basis *b = context;
    pm_path_project(&r->path, b, r->field->dt);
    for (int j = 0; j < r->path.ntime; ++j) {
        for (int i = 0; i < b->nlead; ++i) {
            const double size = fabs(r->path.a[(ptrdiff_t)j * r->path.nmode + i]);
            b->lead_scale[i] = fmax(b->lead_scale[i], size);
        }
    }
    return PM_OK;
}

static pm_status add_flexibility(reduction *r, double weight, void *context) {
    flexibility *x = context;
    const pm_path *p = &r->path;
    const int n = x->b->nstate, count = pm_basis_features(x->b), used = count - n;
    double c[PM_BASIS_MAX_BRANCHES * PM_REDUCE_MAX_MODES];
    pm_path_project(&r->path, x->b, r->field->dt);
    for (int j = 0; j < p->ntime; ++j) {
        pm_reading reading;
        read_path(p, x->b, j, c, &reading);
        pm_basis_fill_features(x->b, &reading, x->all);
        for (int i = 0; i < used; ++i) {
            x->feature[(ptrdiff_t)j * used + i] = weight * x->all[n + i];
        }
        for (int i = 0; i < n; ++i) {
            x->result[(ptrdiff_t)j * n + i] = weight * reading.a[i];
        }
    }
    pm_regression_add(&x->regression, p->ntime, x->feature, x->result);
    return PM_OK;
}

// The symmetric part of what a gains per load, in coordinates where all modes have stiffness 1.
static void take_flexibility(const flexibility *x, double *square) {
    const int n = x->b->nstate, skip = x->b->nbranch * n;
    const double *cross = x->regression.cross + (ptrdiff_t)skip * n;
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
            square[i * n + j] = 0.5 * (cross[i * n + j] + cross[j * n + i]);
        }
    }
}

// Turns the modes by vector [nmode][nmode] and scales them by their flexibility.
static pm_status turn_modes(pm_basis *b, const double *value, const double *vector) {
    const size_t width = 3 * (size_t)b->nnode, n = (size_t)b->nmode;
    double *turned = malloc(n * width * sizeof *turned);
    if (turned == NULL) {
        return no_memory();
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

// What loads may do on a mode that is carried along: in any units of its amplitude.
static double work_of(const flexibility *x, int mode) {
    return x->amplitudes[mode] * x->loads[mode];
}

// Which modes carry the energy, softest first, and then the others, those first on which loads do
// most. Returns how many carry.
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

// Not weighted: the larger the deflection, the more is carried along.
static pm_status measure_modes(reduction *r, double weight, void *context) {
    (void)weight;
    const flexibility *x = context;
    const pm_path *p = &r->path;
    pm_path_project(&r->path, x->b, r->field->dt);
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

static pm_status find_flexibility(reduction *r, flexibility *x) {
    const int n = x->b->nmode;
    double *square = calloc((size_t)(n * n), sizeof *square);
    double *vector = calloc((size_t)(n * n), sizeof *vector);
    double *value = calloc((size_t)n, sizeof *value);
    pm_status status;
    if (square == NULL || vector == NULL || value == NULL) {
        status = no_memory();
        goto done;
    }
    PM_TRY_DONE(for_each(r, find_lead_scale, x->b));
    PM_TRY_DONE(for_each(r, add_flexibility, x));
    PM_TRY_DONE(pm_regression_solve(&x->regression, RIDGE));
    take_flexibility(x, square);
    if (!pm_eigen_largest(n, square, n, value, vector)) {
        status = pm_fail(PM_ENUMERIC, "no eigenvectors of the flexibility");
        goto done;
    }
    PM_TRY_DONE(turn_modes(x->b, value, vector));
    status = for_each(r, measure_modes, x);
done:
    free(square);
    free(vector);
    free(value);
    return status;
}

static pm_status open_flexibility(reduction *r, flexibility *x, pm_basis *b) {
    const int count = pm_basis_features(b), n = b->nmode;
    const size_t ntime = (size_t)r->path.ntime;
    x->b = b;
    x->all = pm_arena_array(&r->arena, (size_t)count, sizeof(double));
    x->feature = pm_arena_array(&r->arena, ntime * (size_t)count, sizeof(double));
    x->result = pm_arena_array(&r->arena, ntime * (size_t)n, sizeof(double));
    x->loads = pm_arena_array(&r->arena, (size_t)n, sizeof(double));
    x->amplitudes = pm_arena_array(&r->arena, (size_t)n, sizeof(double));
    if (x->all == NULL || x->feature == NULL || x->result == NULL || x->loads == NULL ||
        x->amplitudes == NULL) {
        return no_memory();
    }
    return pm_regression_open(&x->regression, count - n, n);
}

// --- the final basis ---

static pm_status set_constants(pm_basis *b, const pm_reduce_how *how, const pm_field *field) {
    b->nbranch = how->nbranch;
    memcpy(b->tau, how->tau, sizeof b->tau);
    b->swing = how->swing;
    b->temperature = how->temperature;
    memcpy(b->position, field->position, 3 * (size_t)field->nnode * sizeof *b->position);
    if (field->hexahedron == NULL) {
        return PM_OK;
    }
    PM_TRY(pm_basis_add_mesh(b, field->nelement));
    memcpy(b->hexahedron, field->hexahedron, 8 * (size_t)b->nelement * sizeof *b->hexahedron);
    return PM_OK;
}

static pm_status pick_modes(reduction *r, const flexibility *x, pm_basis **basis) {
    const pm_basis *all = x->b;
    const size_t width = 3 * (size_t)all->nnode;
    int order[2 * PM_REDUCE_MAX_MODES];
    const int nstate = order_modes(x, r->how->nstate, order);
    if (nstate == 0) {
        return pm_fail(PM_EDATA, "no mode of the displacements follows the loads");
    }
    const int nlead = nstate < r->how->nlead ? nstate : r->how->nlead;
    PM_TRY(pm_basis_new(basis, all->nnode, all->nmode, nstate, nlead));
    PM_TRY(set_constants(*basis, r->how, r->field));
    for (int i = 0; i < all->nmode; ++i) {
        memcpy((*basis)->mode + (size_t)i * width, all->mode + (size_t)order[i] * width,
               width * sizeof *all->mode);
        (*basis)->stiffness[i] = all->stiffness[order[i]];
    }
    return for_each(r, find_lead_scale, *basis);
}

// --- patterns ---

typedef struct remainder_fit {
    const pm_basis *b;
    pm_regression displacement, stress;
    double *feature, *displaced, *stressed; // [ntime] rows
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

static pm_status add_rest(reduction *r, double weight, void *context) {
    remainder_fit *x = context;
    const pm_path *p = &r->path;
    const int count = pm_basis_features(x->b), width = 3 * p->nnode;
    double c[PM_BASIS_MAX_BRANCHES * PM_REDUCE_MAX_MODES];
    pm_path_project(&r->path, x->b, r->field->dt);
    // Stress is weighed by its own size, so that its units do not matter.
    const double stressed =
        p->stress == NULL ? 0 : 1 / norm(2 * (size_t)width * (size_t)p->ntime, p->stress);
    for (int j = 0; j < p->ntime; ++j) {
        pm_reading reading;
        double *feature = x->feature + (ptrdiff_t)j * count;
        read_path(p, x->b, j, c, &reading);
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
        for (ptrdiff_t i = 0; i < 2 * (ptrdiff_t)p->ntime * width; ++i) {
            x->stressed[i] = stressed * p->stress[i];
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

static pm_status fit_patterns(reduction *r, pm_basis *b) {
    const int count = pm_basis_features(b), width = 3 * b->nnode;
    const size_t ntime = (size_t)r->path.ntime;
    remainder_fit x = {
        .b = b,
        .feature = pm_arena_array(&r->arena, ntime * (size_t)count, sizeof(double)),
        .displaced = pm_arena_array(&r->arena, ntime * (size_t)width, sizeof(double)),
        .stressed = pm_arena_array(&r->arena, 2 * ntime * (size_t)width, sizeof(double)),
    };
    const bool stress = r->path.stress != NULL;
    pm_status status;
    if (x.feature == NULL || x.displaced == NULL || x.stressed == NULL) {
        return no_memory();
    }
    PM_TRY_DONE(pm_regression_open(&x.displacement, count, width));
    if (stress) {
        PM_TRY_DONE(pm_regression_open(&x.stress, count, 2 * width));
    }
    PM_TRY_DONE(for_each(r, add_rest, &x));
    PM_TRY_DONE(make_pattern(b, &x.displacement, &b->displacement, r->how->displacement_rank));
    status = stress ? make_pattern(b, &x.stress, &b->stress, r->how->stress_rank) : PM_OK;
done:
    pm_regression_close(&x.displacement);
    pm_regression_close(&x.stress);
    return status;
}

// --- all of it ---

static pm_status open_reduction(reduction *r, int nmode, int nbranch, bool square, bool stress) {
    if (square) {
        r->ncopy = PM_COPIES_OF_SQUARE;
        PM_TRY(pm_copies_make(r->copy, r->field, &r->arena));
    } else {
        r->ncopy = 1;
        PM_TRY(pm_copies_none(&r->copy[0], r->field, &r->arena));
    }
    return pm_path_open(&r->path, r->field, nmode, nbranch, stress);
}

static void close_reduction(reduction *r) {
    pm_path_close(&r->path);
    pm_arena_free(&r->arena);
}

pm_status pm_reduce_fit(pm_basis **basis, const pm_field *field, int count, const int *trajectory,
                        const pm_reduce_how *how) {
    reduction r = {.field = field, .how = how, .count = count, .trajectory = trajectory};
    pm_basis *all = NULL, *picked = NULL;
    flexibility x = {0};
    pm_status status;
    const int nlead = how->nlead < how->nmode ? how->nlead : how->nmode;
    PM_TRY_DONE(open_reduction(&r, how->nmode, how->nbranch, how->square, field->nvariable >= 12));
    PM_TRY_DONE(pm_basis_new(&all, field->nnode, how->nmode, how->nmode, nlead));
    PM_TRY_DONE(set_constants(all, how, field));
    PM_TRY_DONE(decompose(&r, all));
    PM_TRY_DONE(open_flexibility(&r, &x, all));
    PM_TRY_DONE(find_flexibility(&r, &x));
    PM_TRY_DONE(pick_modes(&r, &x, &picked));
    PM_TRY_DONE(fit_patterns(&r, picked));
    *basis = picked;
    picked = NULL;
done:
    pm_regression_close(&x.regression);
    pm_basis_free(picked);
    pm_basis_free(all);
    close_reduction(&r);
    return status;
}

// --- projection ---

// The names of the columns; NULL: out of memory.
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

// Rates at time j of a series with `stride` numbers per time: differences of second order.
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

// One time of a path as a row of the dataset, and its rates.
static void write_row(const pm_path *p, const pm_basis *b, double dt, const double *dissipated,
                      int j, double *z, double *zdot) {
    const int n = b->nstate;
    const ptrdiff_t at = (ptrdiff_t)j * p->nmode;
    for (int i = 0; i < n; ++i) {
        const double rate = difference(p->a + i, p->nmode, p->ntime, j, dt);
        z[i] = p->a[at + i];
        z[n + i] = b->swing * b->swing * rate;
        zdot[i] = rate;
        zdot[n + i] = 0; // quasi-static
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
                            int count, const int *trajectory, bool square) {
    reduction r = {.field = field};
    const int ncolumn = (2 + basis->nbranch) * basis->nstate + 1 + basis->nmode;
    pm_dataset *d = NULL;
    pm_status status;
    if (field->nnode != basis->nnode) {
        return pm_fail(PM_EDATA, "the field has %d nodes, the basis %d", field->nnode,
                       basis->nnode);
    }
    PM_TRY_DONE(open_reduction(&r, basis->nmode, basis->nbranch, square, false));
    const char **name = name_columns(basis, ncolumn, &r.arena);
    if (name == NULL) {
        status = no_memory();
        goto done;
    }
    PM_TRY_DONE(pm_dataset_new(&d, count * r.ncopy, field->ntime, ncolumn, field->dt, name));
    PM_TRY_DONE(pm_dataset_with_rates(d));
    for (int i = 0; i < d->ntrajectory; ++i) {
        const int from = trajectory[i / r.ncopy];
        pm_path_take(&r.path, field, from, &r.copy[i % r.ncopy]);
        pm_path_project(&r.path, basis, field->dt);
        const double *dissipated =
            field->energy == NULL
                ? NULL
                : field->energy + (ptrdiff_t)from * field->ntime * PM_FIELD_ENERGIES + 1;
        for (int j = 0; j < d->ntime; ++j) {
            write_row(&r.path, basis, field->dt, dissipated, j, pm_dataset_state(d, i, j),
                      pm_dataset_rate(d, i, j));
        }
    }
    *dataset = d;
    d = NULL;
done:
    pm_dataset_free(d);
    close_reduction(&r);
    return status;
}
