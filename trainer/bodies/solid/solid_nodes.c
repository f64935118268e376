// Lays the values at all nodes of a body out in columns.
#include "bodies/solid/solid_nodes.h"

#include <stdio.h>
#include <string.h>

pm_status pm_solid_nodes_dataset(pm_dataset **dataset, const pm_solid_data *data, int nstate,
                                 double temperature) {
    const pm_field *field = data->field;
    const int nnode = field->nnode, count = 12 * nnode + 1;
    const int first[] = {0, 3 * nnode, 9 * nnode, 12 * nnode}; // of u, sigma, f, s
    static const char *const group[] = {"u", "sigma", "f"};
    pm_arena arena = {0};
    pm_status status;
    const char **name = pm_arena_array(&arena, (size_t)count, sizeof *name);
    PM_TRY_DONE(pm_arena_status(&arena, "columns"));
    for (int g = 0; g < 3; ++g) {
        for (int i = first[g]; i < first[g + 1]; ++i) {
            name[i] = pm_arena_printf(&arena, "%s%d", group[g], i - first[g]);
        }
    }
    name[count - 1] = "s";
    PM_TRY_DONE(pm_arena_status(&arena, "columns"));
    PM_TRY_DONE(pm_dataset_new(dataset, data->count, nstate, count, field->dt, name));
    for (int k = 0; k < data->count * nstate; ++k) {
        const int i = data->trajectory[k / nstate], j = k % nstate;
        double *row = pm_dataset_state(*dataset, k / nstate, j);
        const double *z = pm_field_state(field, i, j) + data->stress;
        pm_solid_data_displacement(data, i, j, row);
        for (int node = 0; node < nnode; ++node, z += field->nvariable) {
            memcpy(row + first[1] + 6 * (ptrdiff_t)node, z, 6 * sizeof *row);
        }
        memcpy(row + first[2], pm_field_force(field, i, j), 3 * (size_t)nnode * sizeof *row);
        row[first[3]] = pm_solid_data_energy(data, i, j, 1) / temperature;
        for (int m = 0; m < count; ++m) {
            row[m] = (float)row[m];
        }
    }
done:
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

pm_status pm_solid_nodes_fields(pm_field **field, const pm_dataset *nodes, const char *name,
                                const pm_field *body, const int *trajectory) {
    const int u = find_group(nodes, name, "u", 3 * body->nnode);
    const int sigma = find_group(nodes, name, "sigma", 6 * body->nnode);
    const pm_field_shape shape = {nodes->ntrajectory, nodes->ntime,   body->nnode,
                                  PM_BODY_NVARIABLE,  body->nelement, false};
    if (nodes->ntime != body->ntime) {
        return pm_fail(PM_EDATA, "%d states, those of the body are %d", nodes->ntime, body->ntime);
    }
    PM_TRY(pm_field_new(field, shape, body->dt, PM_BODY_VARIABLES));
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
            const double *before = j == 0 ? NULL : pm_field_state(*field, i, j - 1);
            double *z = pm_field_state(*field, i, j);
            for (int node = 0; node < body->nnode; ++node) {
                double *value = z + (ptrdiff_t)node * PM_BODY_NVARIABLE;
                for (int k = 0; k < 3; ++k) {
                    value[k] = body->position[3 * node + k] + row[u + 3 * node + k];
                    value[3 + k] =
                        j == 0 ? 0
                               : (value[k] - before[(ptrdiff_t)node * PM_BODY_NVARIABLE + k]) /
                                     body->dt;
                }
                memcpy(value + 6, row + sigma + 6 * (ptrdiff_t)node, 6 * sizeof *value);
            }
            memcpy(pm_field_force(*field, i, j), pm_field_force(body, trajectory[i], j),
                   nforce * sizeof *row);
        }
    }
    return PM_OK;
}
