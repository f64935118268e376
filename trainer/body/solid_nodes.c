// Lays the values at all nodes of a body out in columns.
#include "body/solid_nodes.h"

#include <stdio.h>
#include <string.h>

// The number of columns of a body, and the first column of each quantity.
typedef struct node_columns {
    int nnode, u, sigma, f, s, count;
} node_columns;

static node_columns layout_of(int nnode) {
    return (node_columns){nnode, 0, 3 * nnode, 9 * nnode, 12 * nnode, 12 * nnode + 1};
}

static pm_status name_group(pm_arena *arena, const char *prefix, int size, const char **name) {
    for (int i = 0; i < size; ++i) {
        name[i] = pm_arena_printf(arena, "%s%d", prefix, i);
        if (name[i] == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for columns");
        }
    }
    return PM_OK;
}

static pm_status name_columns(const node_columns *l, pm_arena *arena, const char **name) {
    PM_TRY(name_group(arena, "u", 3 * l->nnode, name + l->u));
    PM_TRY(name_group(arena, "sigma", 6 * l->nnode, name + l->sigma));
    PM_TRY(name_group(arena, "f", 3 * l->nnode, name + l->f));
    name[l->s] = "s";
    return PM_OK;
}

static void convert_state(const pm_solid_data *data, const node_columns *l, double temperature,
                          int i, int j, double *row) {
    const pm_field *field = data->field;
    const double *z = pm_field_state(field, i, j) + data->stress;
    pm_solid_data_displacement(data, i, j, row + l->u);
    for (int node = 0; node < l->nnode; ++node, z += field->nvariable) {
        memcpy(row + l->sigma + 6 * (ptrdiff_t)node, z, 6 * sizeof *row);
    }
    memcpy(row + l->f, pm_field_force(field, i, j), 3 * (size_t)l->nnode * sizeof *row);
    row[l->s] = pm_solid_data_energy(data, i, j, 1) / temperature;
    for (int k = 0; k < l->count; ++k) {
        row[k] = (float)row[k];
    }
}

static pm_status make_dataset(pm_dataset **dataset, const pm_solid_data *data, int nstate,
                              double temperature, pm_arena *arena) {
    const node_columns l = layout_of(data->field->nnode);
    const char **name = pm_arena_array(arena, (size_t)l.count, sizeof *name);
    PM_TRY(name == NULL ? pm_fail(PM_ENOMEM, "out of memory for columns") : PM_OK);
    PM_TRY(name_columns(&l, arena, name));
    PM_TRY(pm_dataset_new(dataset, data->count, nstate, l.count, data->field->dt, name));
    for (int i = 0; i < data->count; ++i) {
        for (int j = 0; j < nstate; ++j) {
            convert_state(data, &l, temperature, data->trajectory[i], j,
                          pm_dataset_state(*dataset, i, j));
        }
    }
    return PM_OK;
}

pm_status pm_solid_nodes_dataset(pm_dataset **dataset, const pm_solid_data *data, int nstate,
                                 double temperature) {
    pm_arena arena = {0};
    const pm_status status = make_dataset(dataset, data, nstate, temperature, &arena);
    pm_arena_free(&arena);
    return status;
}

// --- back to fields ---

// Returns the first of the columns prefix0 to prefix<count - 1> of a body, which must be
// successive; -1: they are not there.
static int find_group(const pm_dataset *nodes, const char *body, const char *prefix, int count) {
    const char *before = body == NULL ? "" : body, *join = body == NULL ? "" : "_";
    char name[128];
    for (int i = 0; i + count <= nodes->ncolumn; ++i) {
        snprintf(name, sizeof name, "%s%s%s0", before, join, prefix);
        if (strcmp(nodes->column[i], name) == 0) {
            snprintf(name, sizeof name, "%s%s%s%d", before, join, prefix, count - 1);
            return strcmp(nodes->column[i + count - 1], name) == 0 ? i : -1;
        }
    }
    return -1;
}

bool pm_solid_nodes_fit(const pm_dataset *nodes, const char *body, const pm_field *field) {
    return find_group(nodes, body, "u", 3 * field->nnode) >= 0 &&
           find_group(nodes, body, "sigma", 6 * field->nnode) >= 0;
}

// Writes the row of a state to z [nnode][12]; `before` is the state one step earlier, or NULL.
static void restore_state(const pm_field *body, const double *u, const double *sigma,
                          const double *before, double *z) {
    for (int node = 0; node < body->nnode; ++node) {
        double *value = z + (ptrdiff_t)node * 12;
        for (int k = 0; k < 3; ++k) {
            value[k] = body->position[3 * node + k] + u[3 * node + k];
            value[3 + k] =
                before == NULL ? 0 : (value[k] - before[(ptrdiff_t)node * 12 + k]) / body->dt;
        }
        memcpy(value + 6, sigma + 6 * (ptrdiff_t)node, 6 * sizeof *value);
    }
}

pm_status pm_solid_nodes_fields(pm_field **field, const pm_dataset *nodes, const char *name,
                                const pm_field *body, const int *trajectory) {
    const int u = find_group(nodes, name, "u", 3 * body->nnode);
    const int sigma = find_group(nodes, name, "sigma", 6 * body->nnode);
    const pm_field_shape shape = {nodes->ntrajectory, nodes->ntime, body->nnode, 12,
                                  body->nelement,     false};
    if (nodes->ntime != body->ntime) {
        return pm_fail(PM_EDATA, "%d states, those of the body are %d", nodes->ntime, body->ntime);
    }
    PM_TRY(pm_field_new(field, shape, body->dt, "qx qy qz vx vy vz sxx syy szz sxy sxz syz"));
    (*field)->energy = (*field)->clamped = NULL; // not known
    (*field)->placed = body->placed;
    (*field)->placement = body->placement;
    const size_t nforce = 3 * (size_t)body->nnode;
    memcpy((*field)->position, body->position, nforce * sizeof *body->position);
    if (body->nelement > 0) {
        memcpy((*field)->hexahedron, body->hexahedron,
               8 * (size_t)body->nelement * sizeof *body->hexahedron);
    }
    for (int i = 0; i < nodes->ntrajectory; ++i) {
        for (int j = 0; j < nodes->ntime; ++j) {
            const double *row = pm_dataset_state(nodes, i, j);
            restore_state(body, row + u, row + sigma,
                          j == 0 ? NULL : pm_field_state(*field, i, j - 1),
                          pm_field_state(*field, i, j));
            memcpy(pm_field_force(*field, i, j), pm_field_force(body, trajectory[i], j),
                   nforce * sizeof *row);
        }
    }
    return PM_OK;
}
