// Finds the box of bricks that nodes form, and lays their values out in columns.
#include "body/nodes.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

// Two coordinates count as the same if they are this close, relative to the size of the body.
#define SAME_PLACE 1e-6

#define POSITION "qx qy qz"
#define VELOCITY "vx vy vz"
#define STRESS "sxx syy szz sxy sxz syz"

// --- the mesh ---

// Counts the different coordinates along an axis, taken to be evenly spaced, and finds their range.
static int levels_along(const pm_field *field, int axis, double *low, double *high) {
    *low = INFINITY;
    *high = -INFINITY;
    for (int i = 0; i < field->nnode; ++i) {
        *low = fmin(*low, field->position[3 * i + axis]);
        *high = fmax(*high, field->position[3 * i + axis]);
    }
    double next = INFINITY;
    for (int i = 0; i < field->nnode; ++i) {
        const double x = field->position[3 * i + axis] - *low;
        next = x > SAME_PLACE * (*high - *low) ? fmin(next, x) : next;
    }
    return *high > *low ? (int)lround((*high - *low) / next) + 1 : 1;
}

// Finds the body's node of each node of the mesh, node [mesh->nnode].
static pm_status number_nodes(const pm_field *field, const pm_mesh *mesh, const double low[3],
                              int *node) {
    for (int i = 0; i < mesh->nnode; ++i) {
        node[i] = -1;
    }
    for (int i = 0; i < field->nnode; ++i) {
        int at[3];
        for (int c = 0; c < 3; ++c) {
            const double x =
                (field->position[3 * i + c] - low[c]) / mesh->size[c] * mesh->elements[c];
            at[c] = (int)lround(x);
            if (fabs(x - at[c]) > SAME_PLACE * mesh->elements[c]) {
                return pm_fail(PM_EDATA, "node %d is off the grid of a box of bricks", i);
            }
        }
        if (at[0] > 0) {
            node[pm_mesh_node(mesh, at)] = i;
        }
    }
    for (int i = 0; i < mesh->nnode; ++i) {
        if (node[i] < 0) {
            return pm_fail(PM_EDATA, "the nodes do not form a box of bricks: some are missing");
        }
    }
    return PM_OK;
}

pm_status pm_nodes_mesh(const pm_field *field, pm_arena *arena, const pm_mesh **mesh,
                        const int **node) {
    double low[3], high, size[3];
    int elements[3], count = 1;
    for (int c = 0; c < 3; ++c) {
        const int levels = levels_along(field, c, &low[c], &high);
        size[c] = high - low[c];
        elements[c] = levels - 1;
        count = levels > field->nnode / count ? 0 : count * levels;
        if (count == 0 || levels < 2) {
            break;
        }
    }
    if (count != field->nnode) {
        return pm_fail(PM_EDATA, "%d nodes do not form a box of bricks", field->nnode);
    }
    if (pm_mesh_make(size, elements, arena, mesh) != PM_OK) {
        return pm_fail(PM_EDATA, "%s", pm_error()); // the data are wrong, not a configuration
    }
    int *found = pm_arena_array(arena, (size_t)(*mesh)->nnode, sizeof *found);
    if (found == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a mesh");
    }
    *node = found;
    return number_nodes(field, *mesh, low, found);
}

// --- columns ---

// The first column of each group in a row, and the number of columns.
typedef struct row_layout {
    int nnode, nbranch;
    int u, memory, sigma, f, s, count;
} row_layout;

static row_layout layout_of(int nnode, int nbranch) {
    const int vector = 3 * nnode, tensor = 6 * nnode;
    row_layout l = {.nnode = nnode, .nbranch = nbranch, .memory = vector};
    l.sigma = l.memory + nbranch * vector;
    l.f = l.sigma + tensor;
    l.s = l.f + vector;
    l.count = l.s + 1;
    return l;
}

static pm_status name_group(pm_arena *arena, const char *prefix, int first, int size,
                            const char **name) {
    for (int i = 0; i < size; ++i) {
        name[first + i] = pm_arena_printf(arena, "%s%d", prefix, i);
        if (name[first + i] == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for columns");
        }
    }
    return PM_OK;
}

static pm_status name_columns(const row_layout *l, pm_arena *arena, const char **name) {
    PM_TRY(name_group(arena, "u", l->u, 3 * l->nnode, name));
    for (int k = 0; k < l->nbranch; ++k) {
        char prefix[16];
        snprintf(prefix, sizeof prefix, "m%d_", k);
        PM_TRY(name_group(arena, prefix, l->memory + k * 3 * l->nnode, 3 * l->nnode, name));
    }
    PM_TRY(name_group(arena, "sigma", l->sigma, 6 * l->nnode, name));
    PM_TRY(name_group(arena, "f", l->f, 3 * l->nnode, name));
    name[l->s] = "s";
    return PM_OK;
}

// --- fields to nodes ---

typedef struct conversion {
    const pm_field *field;
    const pm_nodes_settings *settings;
    const int *node; // [layout.nnode] the body's node of each free node
    row_layout layout;
    int q, stress; // first variables of the field that are positions, and stresses
} conversion;

// Fills a row with the state at one time; `before` is the row of the time before, or NULL.
static void convert_state(const conversion *c, int trajectory, int time, const double *before,
                          double *row) {
    const pm_field *field = c->field;
    const row_layout *l = &c->layout;
    const double *z = pm_field_state(field, trajectory, time);
    const int end = time + 1 < field->ntime ? time + 1 : time;
    const double *force = pm_field_force(field, trajectory, end);
    for (int i = 0; i < l->nnode; ++i) {
        const int node = c->node[i];
        const double *value = z + (ptrdiff_t)node * field->nvariable;
        for (int k = 0; k < 3; ++k) {
            row[l->u + 3 * i + k] = value[c->q + k] - field->position[3 * node + k];
            row[l->f + 3 * i + k] = force[3 * node + k];
        }
        memcpy(row + l->sigma + 6 * (ptrdiff_t)i, value + c->stress, 6 * sizeof *row);
    }
    for (int b = 0; b < l->nbranch && before != NULL; ++b) {
        const double part = 1 - exp(-field->dt / c->settings->tau[b]);
        const int first = l->memory + b * 3 * l->nnode;
        for (int i = 0; i < 3 * l->nnode; ++i) {
            row[first + i] = before[first + i] + part * (before[l->u + i] - before[first + i]);
        }
    }
    if (field->energy != NULL) {
        const double *energy =
            field->energy +
            ((size_t)trajectory * (size_t)field->ntime + (size_t)time) * PM_FIELD_ENERGIES;
        row[l->s] = energy[1] / c->settings->temperature;
    }
    for (int i = 0; i < l->count; ++i) {
        row[i] = (float)row[i];
    }
}

static pm_status begin(conversion *c, const pm_field *field, const pm_nodes_settings *settings,
                       pm_arena *arena) {
    const pm_mesh *mesh;
    PM_TRY(pm_nodes_mesh(field, arena, &mesh, &c->node));
    c->field = field;
    c->settings = settings;
    c->layout = layout_of(mesh->nnode, settings == NULL ? 0 : settings->nbranch);
    c->q = pm_field_columns(field, POSITION);
    c->stress = pm_field_columns(field, STRESS);
    return c->q < 0 || c->stress < 0
               ? pm_fail(PM_EDATA, "expected variables " POSITION " and " STRESS ", found %s",
                         field->variable)
               : PM_OK;
}

static pm_status fill(pm_dataset **dataset, const conversion *c, int count, const int *trajectory,
                      pm_arena *arena) {
    const row_layout *l = &c->layout;
    const int nstate = c->settings->nstate > 0 ? c->settings->nstate : c->field->ntime;
    const char **name = pm_arena_array(arena, (size_t)l->count, sizeof *name);
    if (name == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for columns");
    }
    PM_TRY(name_columns(l, arena, name));
    PM_TRY(pm_dataset_new(dataset, count, nstate, l->count, c->field->dt, name));
    for (int i = 0; i < count; ++i) {
        for (int j = 0; j < nstate; ++j) {
            convert_state(c, trajectory[i], j, j == 0 ? NULL : pm_dataset_state(*dataset, i, j - 1),
                          pm_dataset_state(*dataset, i, j));
        }
    }
    return PM_OK;
}

pm_status pm_nodes_dataset(pm_dataset **dataset, const pm_field *field, int count,
                           const int *trajectory, const pm_nodes_settings *settings) {
    pm_arena arena = {0};
    conversion c = {0};
    pm_status status = begin(&c, field, settings, &arena);
    if (status == PM_OK) {
        status = fill(dataset, &c, count, trajectory, &arena);
    }
    pm_arena_free(&arena);
    return status;
}

// --- nodes to fields ---

// Returns the first of `count` successive columns called prefix0, prefix1, ...; -1 if there are
// none.
static int find_group(const pm_dataset *nodes, const char *prefix, int count) {
    char name[32];
    snprintf(name, sizeof name, "%s0", prefix);
    for (int i = 0; i + count <= nodes->ncolumn; ++i) {
        if (strcmp(nodes->column[i], name) == 0) {
            snprintf(name, sizeof name, "%s%d", prefix, count - 1);
            return strcmp(nodes->column[i + count - 1], name) == 0 ? i : -1;
        }
    }
    return -1;
}

// Writes the positions and stresses of a row into the free nodes of a state z [nnode][nvariable].
static void restore_state(const conversion *c, const double *row, int u, int sigma, double *z) {
    const pm_field *field = c->field;
    for (int i = 0; i < c->layout.nnode; ++i) {
        const int node = c->node[i];
        double *value = z + (ptrdiff_t)node * field->nvariable;
        for (int k = 0; k < 3; ++k) {
            value[c->q + k] = field->position[3 * node + k] + row[u + 3 * i + k];
        }
        memcpy(value + c->stress, row + sigma + 6 * (ptrdiff_t)i, 6 * sizeof *row);
    }
}

// Sets the variables from v on to the backward differences of those from q on.
static void differentiate(pm_field *field, int trajectory, int q, int v) {
    for (int j = 1; j < field->ntime; ++j) {
        const double *before = pm_field_state(field, trajectory, j - 1);
        double *z = pm_field_state(field, trajectory, j);
        for (int i = 0; i < field->nnode; ++i) {
            for (int k = 0; k < 3; ++k) {
                const ptrdiff_t at = (ptrdiff_t)i * field->nvariable;
                z[at + v + k] = (z[at + q + k] - before[at + q + k]) / field->dt;
            }
        }
    }
}

static pm_status restore(pm_field **field, const conversion *c, const pm_dataset *nodes,
                         const int *trajectory) {
    const pm_field *body = c->field;
    const int n = c->layout.nnode, u = find_group(nodes, "u", 3 * n);
    const int sigma = find_group(nodes, "sigma", 6 * n), v = pm_field_columns(body, VELOCITY);
    if (u < 0 || sigma < 0 || nodes->ntime != body->ntime) {
        return pm_fail(PM_EDATA,
                       "expected columns u[0:%d], sigma[0:%d] and %d states, as the body has them",
                       3 * n, 6 * n, body->ntime);
    }
    const pm_field_shape shape = {nodes->ntrajectory, body->ntime,    body->nnode,
                                  body->nvariable,    body->nelement, false};
    PM_TRY(pm_field_new(field, shape, body->dt, body->variable));
    (*field)->energy = (*field)->clamped = NULL; // not known
    const size_t nstate = (size_t)body->nnode * (size_t)body->nvariable;
    const size_t nforce = (size_t)body->nnode * 3;
    memcpy((*field)->position, body->position, nforce * sizeof *body->position);
    if (body->nelement > 0) {
        memcpy((*field)->hexahedron, body->hexahedron,
               (size_t)body->nelement * 8 * sizeof *body->hexahedron);
    }
    for (int i = 0; i < nodes->ntrajectory; ++i) {
        for (int j = 0; j < body->ntime; ++j) {
            double *z = pm_field_state(*field, i, j);
            memcpy(z, pm_field_state(body, trajectory[i], j),
                   nstate * sizeof *z); // also clamped nodes
            restore_state(c, pm_dataset_state(nodes, i, j), u, sigma, z);
            memcpy(pm_field_force(*field, i, j), pm_field_force(body, trajectory[i], j),
                   nforce * sizeof *z);
        }
        if (v >= 0) {
            differentiate(*field, i, c->q, v);
        }
    }
    return PM_OK;
}

pm_status pm_nodes_fields(pm_field **field, const pm_dataset *nodes, const pm_field *body,
                          const int *trajectory) {
    pm_arena arena = {0};
    conversion c = {0};
    pm_field *made = NULL;
    pm_status status = begin(&c, body, NULL, &arena);
    if (status == PM_OK) {
        status = restore(&made, &c, nodes, trajectory);
    }
    pm_arena_free(&arena);
    if (status != PM_OK) {
        pm_field_free(made);
        return status;
    }
    *field = made;
    return PM_OK;
}
