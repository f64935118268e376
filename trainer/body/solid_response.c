// Steps a learned body along a trajectory of a field.
#include "body/solid_response.h"

#include <float.h>
#include <math.h>
#include <string.h>

// The residual of a step that counts as rounding, relative to the largest energy so far.
#define ROUNDING (1e5 * DBL_EPSILON)

// Adds the squared errors of a state to error [PM_SOLID_NSCORE].
static void add_errors(const pm_solid_data *data, int i, int j, const pm_solid *solid, double heat,
                       const double *u, const double *sigma, double *error) {
    const pm_field *field = data->field;
    const double *z = pm_field_state(field, i, j) + data->stress;
    const double *own = pm_solid_displacement(solid);
    for (int node = 0; node < field->nnode; ++node, z += field->nvariable) {
        for (int k = 0; k < 3 && !data->mesh.clamped[node]; ++k) {
            const double off = own[3 * node + k] - u[3 * node + k];
            error[PM_SOLID_DISPLACEMENT] += off * off;
        }
        for (int k = 0; k < 6 && !data->mesh.clamped[node]; ++k) {
            const double off = sigma[6 * node + k] - z[k];
            error[PM_SOLID_STRESS] += off * off;
        }
    }
    const double energy[2] = {pm_solid_books_of(solid)->stored, heat};
    for (int k = 0; k < 2; ++k) {
        const double off = energy[k] - pm_solid_data_energy(data, i, j, k);
        error[PM_SOLID_STORED + k] += off * off;
    }
}

// Writes the state at time j to trajectory `row` of the fields.
static void keep_state(const pm_solid *solid, const double *sigma,
                       const double energy[PM_FIELD_ENERGIES], const double *f, pm_field *to,
                       int row, int j) {
    const int nnode = to->nnode, nvariable = to->nvariable;
    const double *u = pm_solid_displacement(solid);
    double *z = pm_field_state(to, row, j);
    const double *before = j > 0 ? pm_field_state(to, row, j - 1) : NULL;
    for (int node = 0; node < nnode; ++node, z += nvariable) {
        for (int k = 0; k < 3; ++k) {
            z[k] = to->position[3 * node + k] + u[3 * node + k];
            z[3 + k] =
                before == NULL ? 0 : (z[k] - before[(ptrdiff_t)node * nvariable + k]) / to->dt;
        }
        memcpy(z + 6, sigma + 6 * (ptrdiff_t)node, 6 * sizeof *z);
    }
    memcpy(pm_field_force(to, row, j), f, 3 * (size_t)nnode * sizeof *f);
    memcpy(to->energy + ((size_t)row * (size_t)to->ntime + (size_t)j) * PM_FIELD_ENERGIES, energy,
           PM_FIELD_ENERGIES * sizeof *energy);
}

// Checks both laws over the last step, from the stored energy `before`.
static void check_laws(const pm_solid_books *books, double before, double *largest,
                       pm_solid_response *r) {
    const double residual = fabs(books->stored - before + books->heat - books->work);
    *largest = fmax(*largest, fmax(books->stored, fabs(books->work)));
    r->energy_residual = fmax(r->energy_residual, residual);
    r->least_heat = fmin(r->least_heat, books->heat);
    r->violations += residual > ROUNDING * *largest || books->heat < 0;
}

// Returns the work of the forces of step j, by the trapezoidal rule, J. `last` [nnode][3] are the
// displacements before it.
static double work_of_forces(const pm_solid_data *data, int i, int j, const double *last,
                             const double *u) {
    const double *a = pm_field_force(data->field, i, j - 1), *b = pm_field_force(data->field, i, j);
    double work = 0;
    for (int k = 0; k < 3 * data->field->nnode; ++k) {
        work += (a[k] + b[k]) / 2 * (u[k] - last[k]);
    }
    return work;
}

pm_status pm_solid_respond(const pm_solid_data *data, int i, pm_solid *solid, double *u,
                           double *sigma, pm_field *to, int row, pm_solid_response *r) {
    const pm_field *field = data->field;
    double size[PM_SOLID_NSCORE], energy[PM_FIELD_ENERGIES] = {0}, largest = 0;
    pm_solid_data_size(data, i, u, size);
    pm_solid_set_state(solid, NULL, NULL);
    *r = (pm_solid_response){.least_heat = INFINITY};
    for (int j = 0; j < field->ntime; ++j) {
        const double *f = pm_field_force(field, i, j);
        const double before = pm_solid_books_of(solid)->stored;
        if (j > 0) {
            memcpy(u, pm_solid_displacement(solid), 3 * (size_t)field->nnode * sizeof *u);
            PM_TRY(pm_solid_step(solid, field->dt, f));
            r->work_of_forces += work_of_forces(data, i, j, u, pm_solid_displacement(solid));
            check_laws(pm_solid_books_of(solid), before, &largest, r);
            r->iterations += pm_solid_books_of(solid)->iterations;
            ++r->steps;
        }
        energy[0] = pm_solid_books_of(solid)->stored;
        energy[1] += pm_solid_books_of(solid)->heat;
        energy[2] += pm_solid_books_of(solid)->work;
        pm_solid_stress(solid, sigma);
        pm_solid_data_displacement(data, i, j, u);
        add_errors(data, i, j, solid, energy[1], u, sigma, r->error);
        if (to != NULL) {
            keep_state(solid, sigma, energy, f, to, row, j);
        }
    }
    r->work = energy[2];
    for (int k = 0; k < PM_SOLID_NSCORE; ++k) {
        r->error[k] = size[k] > 0 ? sqrt(r->error[k] / size[k]) : 0;
    }
    return PM_OK;
}
