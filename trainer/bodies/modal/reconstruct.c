// Adds up modes and patterns node by node, and compares fields.
#include "bodies/modal/reconstruct.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define SAME 1e-6 // relative precision of times and places in single precision

// The first variable of each quantity in the result.
enum { Q = 0, V = 3, SIGMA = 6, NVARIABLE = PM_BODY_NVARIABLE };

// The columns of a modal state in a dataset, and the fields that follow from a row.
typedef struct state_reader {
    int *column;     // [nstate + nbranch nstate + nmode] of a, c and loads; NO_COLUMN: zero
    int *momentum;   // [nstate] columns of p
    double *value;   // [nstate + nbranch nstate + nmode] a, c and loads in a row
    double *before;  // [nmode] J^0.5, loads in the row before
    double *delayed; // [nretardation][nmode] J^0.5
    double *feature; // [pm_basis_features]
    double *u, *v;   // [nnode][3] m, m/s
    double *stress;  // [nnode][6] Pa
    double *force;   // [nnode][3] N, of contact, then with the loads
    double *work;    // [pm_local_work]
} state_reader;

#define NO_COLUMN (-1)

// Finds the column of a name, with the name of the body in front unless `body` is NULL. PM_EDATA:
// there is none, unless `optional`.
static pm_status find_column(const pm_dataset *d, const char *body, const char *name, bool optional,
                             int *column) {
    const size_t length = body == NULL ? 0 : strlen(body);
    for (int i = 0; i < d->ncolumn; ++i) {
        const char *own = d->column[i];
        if (length > 0) {
            own = strncmp(own, body, length) == 0 && own[length] == '_' ? own + length + 1 : "";
        }
        if (strcmp(own, name) == 0) {
            *column = i;
            return PM_OK;
        }
    }
    *column = NO_COLUMN;
    return optional ? PM_OK
                    : pm_fail(PM_EDATA,
                              "the dataset has no column \"%s%s%s\"; expected those that `reduce` "
                              "writes",
                              body == NULL ? "" : body, body == NULL ? "" : "_", name);
}

static pm_status open_reader(state_reader *r, const pm_basis *b, const pm_dataset *d,
                             const char *body, pm_arena *arena) {
    const size_t count = (size_t)((1 + b->nbranch) * b->nstate + b->nmode);
    const size_t nnode = (size_t)b->nnode;
    r->column = pm_arena_array(arena, count, sizeof *r->column);
    r->momentum = pm_arena_array(arena, (size_t)b->nstate, sizeof *r->momentum);
    r->value = pm_arena_array(arena, count, sizeof *r->value);
    r->before = pm_arena_array(arena, (size_t)b->nmode, sizeof *r->before);
    r->delayed =
        pm_arena_array(arena, (size_t)(b->nretardation * b->nmode) + 1, sizeof *r->delayed);
    r->feature = pm_arena_array(arena, (size_t)pm_basis_features(b), sizeof *r->feature);
    r->u = pm_arena_array(arena, 3 * nnode, sizeof *r->u);
    r->work = pm_arena_array(arena, pm_local_work(&b->local), sizeof *r->work);
    r->v = pm_arena_array(arena, 3 * nnode, sizeof *r->v);
    r->force = pm_arena_array(arena, 3 * nnode, sizeof *r->force);
    r->stress = pm_arena_array(arena, PM_BASIS_TENSOR * nnode, sizeof *r->stress);
    PM_TRY(pm_arena_status(arena, "a reconstruction"));
    char name[32];
    int *at = r->column;
    for (int i = 0; i < b->nstate; ++i) {
        snprintf(name, sizeof name, "a%d", i);
        PM_TRY(find_column(d, body, name, false, at++));
    }
    for (int i = 0; i < b->nstate; ++i) {
        snprintf(name, sizeof name, "p%d", i);
        PM_TRY(find_column(d, body, name, false, &r->momentum[i]));
    }
    for (int k = 0; k < b->nbranch; ++k) {
        for (int i = 0; i < b->nstate; ++i) {
            snprintf(name, sizeof name, "c%d_%d", k, i);
            PM_TRY(find_column(d, body, name, false, at++));
        }
    }
    for (int i = 0; i < b->nmode; ++i) {
        snprintf(name, sizeof name, i < b->nstate ? "f%d" : "h%d",
                 i < b->nstate ? i : i - b->nstate);
        PM_TRY(find_column(d, body, name, true, at++));
    }
    return PM_OK;
}

// Computes positions, velocities and stresses of the nodes from a row of the dataset, and writes
// them into a state of the result. The velocities are those of the state's modes. `f` [nnode][3]
// are the loads, N; NULL: not known. The rows of a trajectory, a time dt apart, must come in their
// order.
static void reconstruct_row(state_reader *r, const pm_basis *b, const pm_contact_force *contact,
                            const double *row, const double *f, bool first, double dt,
                            double *result) {
    const int n = b->nstate, count = (1 + b->nbranch) * n + b->nmode;
    const int nfeature = pm_basis_features(b);
    const ptrdiff_t width = 3 * (ptrdiff_t)b->nnode;
    double *load = r->value + (1 + b->nbranch) * n;
    for (int i = 0; i < count; ++i) {
        r->value[i] = r->column[i] == NO_COLUMN ? 0 : row[r->column[i]];
    }
    // The contact forces are loads on the modes.
    memset(r->force, 0, (size_t)width * sizeof *r->force);
    if (contact != NULL) {
        pm_contact_force_add(contact, row, r->force);
        for (int i = 0; i < b->nmode; ++i) {
            for (ptrdiff_t k = 0; k < width; ++k) {
                load[i] += b->mode[i * width + k] * r->force[k];
            }
        }
    }
    // The delayed loads, which are the loads themselves in the first row.
    for (int k = 0; k < b->nretardation; ++k) {
        double *delayed = r->delayed + (ptrdiff_t)k * b->nmode;
        if (first) {
            memcpy(delayed, load, (size_t)b->nmode * sizeof *load);
        } else {
            pm_basis_relax(b->nmode, b->retardation[k], dt, r->before, load, delayed);
        }
    }
    memcpy(r->before, load, (size_t)b->nmode * sizeof *load);
    const pm_modal_state state = {r->value, r->value + n, load, r->delayed};
    pm_basis_fill_features(b, &state, r->feature);
    memset(r->u, 0, (size_t)width * sizeof *r->u);
    memset(r->stress, 0, 2 * (size_t)width * sizeof *r->stress);
    memset(r->v, 0, (size_t)width * sizeof *r->v);
    for (int i = 0; i < n; ++i) {
        const double rate = row[r->momentum[i]] / (b->inertia_time * b->inertia_time);
        for (ptrdiff_t k = 0; k < width; ++k) {
            r->u[k] += state.a[i] * b->mode[i * width + k];
            r->v[k] += rate * b->mode[i * width + k];
        }
    }
    pm_pattern_add(&b->displacement, nfeature, r->feature, r->u);
    pm_pattern_add(&b->stress, nfeature, r->feature, r->stress);
    // The stress close to contact forces and loads.
    for (ptrdiff_t k = 0; k < width && f != NULL; ++k) {
        r->force[k] += f[k];
    }
    pm_local_add(&b->local, r->force, r->stress, r->work);
    for (int k = 0; k < b->nnode; ++k, result += NVARIABLE) {
        for (int c = 0; c < 3; ++c) {
            result[Q + c] = b->position[3 * k + c] + r->u[3 * k + c];
            result[V + c] = r->v[3 * k + c];
        }
        memcpy(result + SIGMA, r->stress + PM_BASIS_TENSOR * (ptrdiff_t)k,
               PM_BASIS_TENSOR * sizeof *result);
    }
}

pm_status pm_reconstruct(pm_field **field, const pm_basis *basis, const pm_dataset *modes,
                         const char *body, const pm_contact_force *contact, const pm_field *loads,
                         const int *trajectory) {
    const pm_field_shape shape = {.ntrajectory = modes->ntrajectory,
                                  .ntime = modes->ntime,
                                  .nnode = basis->nnode,
                                  .nvariable = NVARIABLE,
                                  .nelement = basis->nelement};
    pm_arena arena = {0};
    pm_field *d = NULL;
    state_reader r;
    pm_status status;
    if (loads != NULL && (loads->nnode != basis->nnode || loads->ntime != modes->ntime)) {
        PM_TRY_DONE(pm_fail(PM_EDATA, "loads of %d nodes at %d times, expected %d nodes, %d times",
                            loads->nnode, loads->ntime, basis->nnode, modes->ntime));
    }
    PM_TRY_DONE(open_reader(&r, basis, modes, body, &arena));
    PM_TRY_DONE(pm_field_new(&d, shape, modes->dt, PM_BODY_VARIABLES));
    d->energy = d->clamped = NULL; // they are not known
    memcpy(d->t, modes->t, (size_t)d->ntime * sizeof *d->t);
    memcpy(d->position, basis->position, 3 * (size_t)d->nnode * sizeof *d->position);
    if (d->nelement > 0) {
        memcpy(d->hexahedron, basis->hexahedron, 8 * (size_t)d->nelement * sizeof *d->hexahedron);
    }
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int j = 0; j < d->ntime; ++j) {
            const double *f = loads == NULL ? NULL : pm_field_force(loads, trajectory[i], j);
            reconstruct_row(&r, basis, contact, pm_dataset_state(modes, i, j), f, j == 0, modes->dt,
                            pm_field_state(d, i, j));
        }
    }
    *field = d;
    d = NULL;
done:
    pm_field_free(d);
    pm_arena_free(&arena);
    return status;
}

// --- errors ---

// The variables that are compared, indexed by pm_field_error.
static const struct compared_quantity {
    const char *names;
    int count;
} quantities[PM_FIELD_NERROR] = {
    {"qx qy qz", 3}, {"vx vy vz", 3}, {"sxx syy szz sxy sxz syz", PM_BASIS_TENSOR}};

// Returns the first variable of quantity e at a node.
static const double *value_of(const pm_field *field, int column, int trajectory, int node,
                              int time) {
    return pm_field_state(field, trajectory, time) + (ptrdiff_t)node * field->nvariable + column;
}

pm_status pm_field_errors(const pm_field *predicted, const pm_field *truth, const int *trajectory,
                          double *error) {
    static const double none[PM_BASIS_TENSOR];
    int column[2][PM_FIELD_NERROR]; // of the prediction, and of the truth
    double size = 0, off = 0;
    if (truth->nnode != predicted->nnode || truth->ntime != predicted->ntime ||
        fabs(truth->dt - predicted->dt) > SAME * predicted->dt) {
        return pm_fail(PM_EDATA,
                       "the truth has %d states of %d nodes, %g s apart; expected %d states of %d "
                       "nodes, %g s apart",
                       truth->ntime, truth->nnode, truth->dt, predicted->ntime, predicted->nnode,
                       predicted->dt);
    }
    for (int i = 0; i < 3 * truth->nnode; ++i) {
        size = fmax(size, fabs(predicted->position[i]));
        off = fmax(off, fabs(truth->position[i] - predicted->position[i]));
    }
    if (off > SAME * size) {
        return pm_fail(PM_EDATA, "a node of the truth lies %g m from where it is expected", off);
    }
    for (int e = 0; e < 2 * PM_FIELD_NERROR; ++e) {
        const pm_field *field = e < PM_FIELD_NERROR ? predicted : truth;
        const char *names = quantities[e % PM_FIELD_NERROR].names;
        int *found = &column[e / PM_FIELD_NERROR][e % PM_FIELD_NERROR];
        *found = pm_field_columns(field, names);
        if (*found < 0) {
            return pm_fail(PM_EDATA, "a field to compare has no \"%s\" among \"%s\"", names,
                           field->variable);
        }
    }
    for (int i = 0; i < predicted->ntrajectory; ++i) {
        double different[PM_FIELD_NERROR] = {0}, whole[PM_FIELD_NERROR] = {0};
        for (int n = 0; n < truth->nnode; ++n) {
            const double *at = truth->position + 3 * (ptrdiff_t)n;
            bool moves = false;
            for (int j = 0; j < truth->ntime && !moves; ++j) {
                const double *q =
                    value_of(truth, column[1][PM_ERROR_DISPLACEMENT], trajectory[i], n, j);
                moves = q[0] != at[0] || q[1] != at[1] || q[2] != at[2];
            }
            for (int e = 0; e < PM_FIELD_NERROR && (e != PM_ERROR_STRESS || moves); ++e) {
                const double *origin = e == PM_ERROR_DISPLACEMENT ? at : none;
                for (int j = 0; j < truth->ntime; ++j) {
                    const double *found = value_of(predicted, column[0][e], i, n, j);
                    const double *expected = value_of(truth, column[1][e], trajectory[i], n, j);
                    for (int k = 0; k < quantities[e].count; ++k) {
                        different[e] += (found[k] - expected[k]) * (found[k] - expected[k]);
                        whole[e] += (expected[k] - origin[k]) * (expected[k] - origin[k]);
                    }
                }
            }
        }
        for (int e = 0; e < PM_FIELD_NERROR; ++e) {
            error[(ptrdiff_t)i * PM_FIELD_NERROR + e] =
                different[e] == 0 ? 0 : sqrt(different[e] / whole[e]);
        }
    }
    return PM_OK;
}
