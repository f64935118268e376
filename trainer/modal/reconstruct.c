// Adds up modes and patterns node by node, and compares fields.
#include "modal/reconstruct.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SAME 1e-6 // relative precision of times and places in single precision

// The first variable of each quantity in the result.
enum { Q = 0, V = 3, SIGMA = 6, NVARIABLE = 12 };

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

// Returns the column of a name, with the name of the body in front unless `body` is NULL.
static int find_column(const pm_dataset *d, const char *body, const char *name) {
    const size_t length = body == NULL ? 0 : strlen(body);
    for (int i = 0; i < d->ncolumn; ++i) {
        const char *column = d->column[i];
        if (length > 0) {
            column = strncmp(column, body, length) == 0 && column[length] == '_'
                         ? column + length + 1
                         : "";
        }
        if (strcmp(column, name) == 0) {
            return i;
        }
    }
    return NO_COLUMN;
}

static pm_status require_column(const pm_dataset *d, const char *body, const char *name,
                                int *column) {
    *column = find_column(d, body, name);
    return *column != NO_COLUMN
               ? PM_OK
               : pm_fail(
                     PM_EDATA,
                     "the dataset has no column \"%s%s%s\"; expected those that `reduce` writes",
                     body == NULL ? "" : body, body == NULL ? "" : "_", name);
}

static pm_status find_columns(state_reader *r, const pm_basis *b, const pm_dataset *d,
                              const char *body) {
    char name[32];
    int *at = r->column;
    for (int i = 0; i < b->nstate; ++i) {
        snprintf(name, sizeof name, "a%d", i);
        PM_TRY(require_column(d, body, name, at++));
    }
    for (int i = 0; i < b->nstate; ++i) {
        snprintf(name, sizeof name, "p%d", i);
        PM_TRY(require_column(d, body, name, &r->momentum[i]));
    }
    for (int k = 0; k < b->nbranch; ++k) {
        for (int i = 0; i < b->nstate; ++i) {
            snprintf(name, sizeof name, "c%d_%d", k, i);
            PM_TRY(require_column(d, body, name, at++));
        }
    }
    for (int i = 0; i < b->nmode; ++i) {
        snprintf(name, sizeof name, i < b->nstate ? "f%d" : "h%d",
                 i < b->nstate ? i : i - b->nstate);
        *at++ = find_column(d, body, name);
    }
    return PM_OK;
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
    if (r->column == NULL || r->momentum == NULL || r->value == NULL || r->before == NULL ||
        r->delayed == NULL || r->feature == NULL || r->u == NULL || r->v == NULL ||
        r->work == NULL || r->stress == NULL || r->force == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a reconstruction");
    }
    return find_columns(r, b, d, body);
}

// Sets r->force to the contact forces on the body, and adds them to the loads on its modes.
static void add_contact(state_reader *r, const pm_basis *b, const pm_contact_force *contact,
                        const double *row) {
    const ptrdiff_t width = 3 * (ptrdiff_t)b->nnode;
    double *load = r->value + (1 + b->nbranch) * b->nstate;
    memset(r->force, 0, (size_t)width * sizeof *r->force);
    if (contact == NULL) {
        return;
    }
    pm_contact_force_add(contact, row, r->force);
    for (int i = 0; i < b->nmode; ++i) {
        for (ptrdiff_t k = 0; k < width; ++k) {
            load[i] += b->mode[i * width + k] * r->force[k];
        }
    }
}

// Advances the delayed loads to the loads of this row, a time dt after the row before. In the first
// row of a trajectory they are the loads themselves.
static void delay_loads(state_reader *r, const pm_basis *b, bool first, double dt) {
    const double *load = r->value + (1 + b->nbranch) * b->nstate;
    const size_t size = (size_t)b->nmode * sizeof *load;
    for (int k = 0; k < b->nretardation; ++k) {
        double *delayed = r->delayed + (ptrdiff_t)k * b->nmode;
        if (first) {
            memcpy(delayed, load, size);
        } else {
            pm_basis_relax(b->nmode, b->retardation[k], dt, r->before, load, delayed);
        }
    }
    memcpy(r->before, load, size);
}

// Computes r->u, r->v and r->stress from one row of the dataset, without the local stress. The
// velocities are those of the state's modes. The rows of a trajectory must come in their order.
static void read_row(state_reader *r, const pm_basis *b, const pm_contact_force *contact,
                     const double *row, bool first, double dt) {
    const int n = b->nstate, count = (1 + b->nbranch) * n + b->nmode;
    const int nfeature = pm_basis_features(b);
    const ptrdiff_t width = 3 * (ptrdiff_t)b->nnode;
    for (int i = 0; i < count; ++i) {
        r->value[i] = r->column[i] == NO_COLUMN ? 0 : row[r->column[i]];
    }
    add_contact(r, b, contact, row);
    delay_loads(r, b, first, dt);
    const pm_modal_state state = {r->value, r->value + n, r->value + (1 + b->nbranch) * n,
                                  r->delayed};
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
}

// Adds to r->stress the stress close to contact forces and, if they are known, to the loads f.
static void add_local(state_reader *r, const pm_basis *b, const double *f) {
    for (ptrdiff_t k = 0; k < 3 * (ptrdiff_t)b->nnode && f != NULL; ++k) {
        r->force[k] += f[k];
    }
    pm_local_add(&b->local, r->force, r->stress, r->work);
}

// Writes positions, velocities and stresses of the nodes into a state of the result.
static void write_state(const state_reader *r, const pm_basis *b, double *state) {
    for (int k = 0; k < b->nnode; ++k, state += NVARIABLE) {
        for (int c = 0; c < 3; ++c) {
            state[Q + c] = b->position[3 * k + c] + r->u[3 * k + c];
            state[V + c] = r->v[3 * k + c];
        }
        memcpy(state + SIGMA, r->stress + PM_BASIS_TENSOR * (ptrdiff_t)k,
               PM_BASIS_TENSOR * sizeof *state);
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
        status = pm_fail(PM_EDATA, "loads of %d nodes at %d times, expected %d nodes, %d times",
                         loads->nnode, loads->ntime, basis->nnode, modes->ntime);
        goto done;
    }
    PM_TRY_DONE(open_reader(&r, basis, modes, body, &arena));
    PM_TRY_DONE(pm_field_new(&d, shape, modes->dt, "qx qy qz vx vy vz sxx syy szz sxy sxz syz"));
    d->energy = d->clamped = NULL; // they are not known
    memcpy(d->t, modes->t, (size_t)d->ntime * sizeof *d->t);
    memcpy(d->position, basis->position, 3 * (size_t)d->nnode * sizeof *d->position);
    if (d->nelement > 0) {
        memcpy(d->hexahedron, basis->hexahedron, 8 * (size_t)d->nelement * sizeof *d->hexahedron);
    }
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int j = 0; j < d->ntime; ++j) {
            read_row(&r, basis, contact, pm_dataset_state(modes, i, j), j == 0, modes->dt);
            add_local(&r, basis, loads == NULL ? NULL : pm_field_force(loads, trajectory[i], j));
            write_state(&r, basis, pm_field_state(d, i, j));
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

static pm_status find_quantities(const pm_field *field, int column[PM_FIELD_NERROR]) {
    for (int e = 0; e < PM_FIELD_NERROR; ++e) {
        column[e] = pm_field_columns(field, quantities[e].names);
        if (column[e] < 0) {
            return pm_fail(PM_EDATA, "a field to compare has no \"%s\" among \"%s\"",
                           quantities[e].names, field->variable);
        }
    }
    return PM_OK;
}

static pm_status check_like(const pm_field *predicted, const pm_field *truth) {
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
    return off <= SAME * size
               ? PM_OK
               : pm_fail(PM_EDATA, "a node of the truth lies %g m from where it is expected", off);
}

// A trajectory of one of the two fields of a comparison.
typedef struct compared_field {
    const pm_field *field;
    int trajectory;
    int column[PM_FIELD_NERROR];
} compared_field;

static const double *value_of(const compared_field *c, int quantity, int node, int time) {
    return pm_field_state(c->field, c->trajectory, time) + (ptrdiff_t)node * c->field->nvariable +
           c->column[quantity];
}

// Returns true if a node moves at any time.
static bool moves(const compared_field *truth, int node) {
    const double *at = truth->field->position + 3 * (ptrdiff_t)node;
    for (int j = 0; j < truth->field->ntime; ++j) {
        const double *q = value_of(truth, PM_ERROR_DISPLACEMENT, node, j);
        if (q[0] != at[0] || q[1] != at[1] || q[2] != at[2]) {
            return true;
        }
    }
    return false;
}

// Adds the squares of the differences and of the true values of one node over all times.
static void compare_node(const compared_field *predicted, const compared_field *truth, int quantity,
                         int node, double *different, double *whole) {
    static const double none[PM_BASIS_TENSOR];
    const double *origin =
        quantity == PM_ERROR_DISPLACEMENT ? truth->field->position + 3 * (ptrdiff_t)node : none;
    for (int j = 0; j < truth->field->ntime; ++j) {
        const double *found = value_of(predicted, quantity, node, j);
        const double *expected = value_of(truth, quantity, node, j);
        for (int k = 0; k < quantities[quantity].count; ++k) {
            *different += (found[k] - expected[k]) * (found[k] - expected[k]);
            *whole += (expected[k] - origin[k]) * (expected[k] - origin[k]);
        }
    }
}

static void compare_trajectory(const compared_field *predicted, const compared_field *truth,
                               double *error) {
    double different[PM_FIELD_NERROR] = {0}, whole[PM_FIELD_NERROR] = {0};
    for (int i = 0; i < truth->field->nnode; ++i) {
        for (int e = 0; e < PM_FIELD_NERROR; ++e) {
            if (e != PM_ERROR_STRESS || moves(truth, i)) {
                compare_node(predicted, truth, e, i, &different[e], &whole[e]);
            }
        }
    }
    for (int e = 0; e < PM_FIELD_NERROR; ++e) {
        error[e] = different[e] == 0 ? 0 : sqrt(different[e] / whole[e]);
    }
}

pm_status pm_field_errors(const pm_field *predicted, const pm_field *truth, const int *trajectory,
                          double *error) {
    compared_field one = {.field = predicted}, other = {.field = truth};
    PM_TRY(check_like(predicted, truth));
    PM_TRY(find_quantities(predicted, one.column));
    PM_TRY(find_quantities(truth, other.column));
    for (int i = 0; i < predicted->ntrajectory; ++i) {
        one.trajectory = i;
        other.trajectory = trajectory[i];
        compare_trajectory(&one, &other, error + (ptrdiff_t)i * PM_FIELD_NERROR);
    }
    return PM_OK;
}
