// Makes meshes and displacements of fields.
#include "bodies/solid/solid_data.h"

#include <math.h>
#include <string.h>

// A displacement below this share of the largest one is none: some solvers leave rounding errors.
#define STILL 1e-9

pm_status pm_solid_data_open(pm_solid_data *data, const pm_field *field, pm_arena *arena) {
    *data = (pm_solid_data){.field = field,
                            .position = pm_field_columns(field, "qx qy qz"),
                            .stress = pm_field_columns(field, "sxx syy szz sxy sxz syz")};
    if (field->hexahedron == NULL || data->position < 0 || data->stress < 0) {
        return pm_fail(PM_EDATA, "expected fields with elements, positions qx qy qz, and stresses "
                                 "sxx syy szz sxy sxz syz");
    }
    const size_t nnode = (size_t)field->nnode, corners = 8 * (size_t)field->nelement;
    int *brick = pm_arena_array(arena, corners, sizeof *brick);
    bool *clamped = pm_arena_array(arena, nnode, sizeof *clamped);
    double *u = pm_arena_array(arena, 3 * nnode, sizeof *u);
    data->trajectory = pm_arena_array(arena, (size_t)field->ntrajectory, sizeof *data->trajectory);
    PM_TRY(pm_arena_status(arena, "the mesh of a solid"));
    for (size_t i = 0; i < corners; ++i) {
        brick[i] = (int)field->hexahedron[i];
    }
    // A node that never moves is clamped.
    double most = 0;
    memset(clamped, true, nnode * sizeof *clamped);
    for (int pass = 0; pass < 2; ++pass) {
        for (int i = 0; i < field->ntrajectory * field->ntime; ++i) {
            pm_solid_data_displacement(data, i / field->ntime, i % field->ntime, u);
            for (int k = 0; k < 3 * field->nnode; ++k) {
                most = pass == 0 ? fmax(most, fabs(u[k])) : most;
                clamped[k / 3] = clamped[k / 3] && (pass == 0 || fabs(u[k]) <= STILL * most);
            }
        }
    }
    for (; data->count < field->ntrajectory; ++data->count) {
        data->trajectory[data->count] = data->count;
    }
    data->mesh = (pm_solid_mesh){.nnode = field->nnode,
                                 .nelement = field->nelement,
                                 .position = field->position,
                                 .brick = brick,
                                 .clamped = clamped};
    return PM_OK;
}

void pm_solid_data_displacement(const pm_solid_data *data, int i, int j, double *u) {
    const pm_field *field = data->field;
    const double *z = pm_field_state(field, i, j) + data->position;
    for (int k = 0; k < 3 * field->nnode; ++k) {
        u[k] = z[(ptrdiff_t)(k / 3) * field->nvariable + k % 3] - field->position[k];
    }
}

double pm_solid_data_energy(const pm_solid_data *data, int i, int j, int which) {
    const pm_field *field = data->field;
    const size_t at = (size_t)i * (size_t)field->ntime + (size_t)j;
    return field->energy == NULL ? 0 : field->energy[at * PM_FIELD_ENERGIES + (size_t)which];
}

void pm_solid_data_size(const pm_solid_data *data, int i, double *u, double size[PM_SOLID_NSCORE]) {
    const pm_field *field = data->field;
    memset(size, 0, PM_SOLID_NSCORE * sizeof *size);
    for (int j = 0; j < field->ntime; ++j) {
        const double *z = pm_field_state(field, i, j) + data->stress;
        pm_solid_data_displacement(data, i, j, u);
        for (int node = 0; node < field->nnode; ++node, z += field->nvariable) {
            for (int k = 0; k < 3 && !data->mesh.clamped[node]; ++k) {
                size[PM_SOLID_DISPLACEMENT] += u[3 * node + k] * u[3 * node + k];
            }
            for (int k = 0; k < 6 && !data->mesh.clamped[node]; ++k) {
                size[PM_SOLID_STRESS] += z[k] * z[k];
            }
        }
        for (int k = 0; k < 2; ++k) {
            const double energy = pm_solid_data_energy(data, i, j, k);
            size[PM_SOLID_STORED + k] += energy * energy;
        }
    }
}
