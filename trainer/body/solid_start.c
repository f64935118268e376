// The constants and the first weights of a learned material, from its data.
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "body/solid_fit.h"

// The largest and the mean squares of the strain and of the change of volume, the mean of the
// latter times the mean stress, and the mean stored energy.
typedef struct data_scale {
    double most_strain, most_volume, strain, volume; // no unit, squared
    double pressure;                                 // Pa
    double energy;                                   // J/m^3
    double step, whole; // s, the step and the length of the trajectories
} data_scale;

// Adds a state of a body: u [nnode][3] are its displacements, and sigma its stresses, whose nodes
// are nvariable numbers apart.
static void add_state(const pm_solid_data *data, const double *u, const double *sigma,
                      data_scale *sum) {
    const pm_solid_mesh *mesh = &data->mesh;
    double strain = 0, volume = 0, pressure = 0;
    for (int e = 0; e < mesh->nelement; ++e) {
        pm_brick brick;
        double x[3 * PM_BRICK_NODES], w[3 * PM_BRICK_NODES], J = 0, mean = 0;
        for (int k = 0; k < 3 * PM_BRICK_NODES; ++k) {
            const int at = 3 * mesh->brick[e * PM_BRICK_NODES + k / 3] + k % 3;
            x[k] = mesh->position[at];
            w[k] = u[at];
            mean +=
                sigma[(ptrdiff_t)(at / 3) * data->field->nvariable + at % 3] / (3 * PM_BRICK_NODES);
        }
        if (!pm_brick_make(&brick, x)) {
            continue;
        }
        double F[PM_BRICK_POINTS][9];
        pm_brick_deform(&brick, w, F);
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            pm_solid_shape shape;
            memcpy(shape.F, F[p], sizeof F[p]);
            if (pm_solid_shape_make(&shape)) {
                const double square = pm_sym_trace(shape.Cbar) - 3;
                strain += square / (PM_BRICK_POINTS * mesh->nelement);
                sum->most_strain = fmax(sum->most_strain, square);
                J += brick.weight[p] * shape.J / brick.volume;
            }
        }
        volume += (J - 1) * (J - 1) / mesh->nelement;
        sum->most_volume = fmax(sum->most_volume, (J - 1) * (J - 1));
        pressure += (J - 1) * mean / mesh->nelement;
    }
    sum->strain += strain;
    sum->volume += volume;
    sum->pressure += pressure;
}

// Returns the stored energy of trajectory i at time j, J; without energies, what a linear body
// stores under the forces.
static double energy_of(const pm_solid_data *data, int i, int j, const double *u) {
    const double *f = pm_field_force(data->field, i, j);
    double work = 0;
    for (int k = 0; k < 3 * data->field->nnode; ++k) {
        work += f[k] * u[k] / 2;
    }
    return data->field->energy == NULL ? work : pm_solid_data_energy(data, i, j, 0);
}

static pm_status find_scale(const pm_solid_data *data, data_scale *scale, double *count) {
    const pm_field *field = data->field;
    double *u = calloc(3 * (size_t)field->nnode, sizeof *u), body = 0;
    if (u == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the start of a fit");
    }
    for (int e = 0; e < data->mesh.nelement; ++e) {
        pm_brick brick;
        double x[3 * PM_BRICK_NODES];
        for (int k = 0; k < 3 * PM_BRICK_NODES; ++k) {
            x[k] = field->position[3 * data->mesh.brick[e * PM_BRICK_NODES + k / 3] + k % 3];
        }
        body += pm_brick_make(&brick, x) ? brick.volume : 0;
    }
    for (int k = 0; k < data->count * field->ntime; ++k) {
        const int i = data->trajectory[k / field->ntime], j = k % field->ntime;
        pm_solid_data_displacement(data, i, j, u);
        add_state(data, u, pm_field_state(field, i, j) + data->stress, scale);
        scale->energy += energy_of(data, i, j, u) / fmax(body, DBL_MIN);
        *count += 1;
    }
    scale->step = field->dt;
    scale->whole = fmax(scale->whole, field->dt * (field->ntime - 1));
    free(u);
    return PM_OK;
}

// Sets the scales of the two inputs of a function.
static void set_scale(const pm_params *params, const char *name, double first, double second) {
    char full[64];
    snprintf(full, sizeof full, "%s.scale", name);
    double *scale = pm_params_find(params, full)->value;
    scale[0] = first > 0 ? first : 1;
    scale[1] = second > 0 ? second : 1;
}

pm_status pm_solid_fit_start(const pm_solid_fit_settings *settings, pm_params *params) {
    data_scale s = {0};
    double count = 0;
    for (int d = 0; d < settings->ndata; ++d) {
        PM_TRY(find_scale(&settings->data[d], &s, &count));
    }
    // The inputs of learned functions are at most 1 in the data.
    const double strain = s.most_strain, volume = s.most_volume;
    const double unit = s.energy > 0 ? s.energy / s.strain * strain : 1;
    const int n = settings->spec.nbranch;
    pm_params_find(params, "unit")->value[0] = unit;
    // The spring and the branches share the energy evenly. The stiffness of volume follows from the
    // mean stress, because little energy is in it.
    pm_params_find(params, "spring.linear")->value[0] = -log(n + 1.0);
    if (s.pressure > 0) {
        pm_params_find(params, "volume.linear")->value[0] =
            log(s.pressure / s.volume * volume / (2 * unit));
    }
    set_scale(params, "spring", strain, strain);
    set_scale(params, "volume", volume, volume * sqrt(volume));
    for (int b = 0; b < n; ++b) {
        char name[40];
        snprintf(name, sizeof name, "branch%d", b);
        set_scale(params, name, strain, strain * sqrt(strain));
        // The first relaxation times divide the range from a step to a trajectory evenly.
        snprintf(name, sizeof name, "branch%d.linear", b);
        pm_params_find(params, name)->value[0] = -log(n + 1.0);
        snprintf(name, sizeof name, "branch%d.relaxation", b);
        const double time = s.step * pow(s.whole / s.step, (b + 1.0) / (n + 1));
        pm_params_find(params, name)->value[0] = -log(time);
    }
    return PM_OK;
}
