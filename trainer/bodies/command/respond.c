// portmet-train respond: computes how a body of learned material responds to forces.
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "base/files.h"
#include "base/options.h"
#include "base/python.h"
#include "bodies/bodies.h"
#include "bodies/command/fields.h"
#include "bodies/solid/solid_data.h"
#include "scene/weights.h"
#include "sim/score.h"

// The residual of a step that counts as rounding, relative to the largest energy so far.
#define ROUNDING (1e5 * DBL_EPSILON)

// How well the body follows one trajectory.
typedef struct response {
    double error[PM_SOLID_NSCORE]; // relative L2 errors over the trajectory
    double energy_residual;        // J, largest |change of stored energy + heat - work| of a step
    double least_heat;             // J, of a step
    int violations; // steps in which energy is not conserved to rounding, or heat is negative
    double work, work_of_forces; // J, of the body, and of the forces by the trapezoidal rule
    long steps, iterations;      // of all balances of forces
} response;

// Starts the undeformed body at the first state of trajectory i and lets the forces of the field
// act on it. Trajectory `row` of `to` receives the positions, velocities, stresses, forces and
// energies; `to` may be NULL. `u` [nnode][3] and `sigma` [nnode][6] are work space.
static pm_status follow(const pm_solid_data *data, int i, pm_solid *solid, double *u, double *sigma,
                        pm_field *to, int row, response *r) {
    const pm_field *field = data->field;
    double size[PM_SOLID_NSCORE], energy[PM_FIELD_ENERGIES] = {0}, largest = 0;
    pm_solid_data_size(data, i, u, size);
    pm_solid_set_state(solid, NULL, NULL);
    *r = (response){.least_heat = INFINITY};
    for (int j = 0; j < field->ntime; ++j) {
        const pm_solid_books *books = pm_solid_books_of(solid);
        const double *f = pm_field_force(field, i, j), before = books->stored;
        if (j > 0) {
            const double *f_last = pm_field_force(field, i, j - 1);
            memcpy(u, pm_solid_displacement(solid), 3 * (size_t)field->nnode * sizeof *u);
            PM_TRY(pm_solid_step(solid, field->dt, f));
            books = pm_solid_books_of(solid);
            const double *now = pm_solid_displacement(solid);
            double work = 0; // of the forces, by the trapezoidal rule
            for (int k = 0; k < 3 * field->nnode; ++k) {
                work += (f_last[k] + f[k]) / 2 * (now[k] - u[k]);
            }
            r->work_of_forces += work;
            // Both laws over this step.
            const double residual = fabs(books->stored - before + books->heat - books->work);
            largest = fmax(largest, fmax(books->stored, fabs(books->work)));
            r->energy_residual = fmax(r->energy_residual, residual);
            r->least_heat = fmin(r->least_heat, books->heat);
            r->violations += residual > ROUNDING * largest || books->heat < 0;
            r->iterations += books->iterations;
            ++r->steps;
        }
        energy[0] = books->stored;
        energy[1] += books->heat;
        energy[2] += books->work;
        pm_solid_stress(solid, sigma);
        pm_solid_data_displacement(data, i, j, u);
        const double *own = pm_solid_displacement(solid);
        const double *sigma_of = pm_field_state(field, i, j) + data->stress;
        for (int node = 0; node < field->nnode; ++node, sigma_of += field->nvariable) {
            for (int k = 0; k < 3 && !data->mesh.clamped[node]; ++k) {
                const double off = own[3 * node + k] - u[3 * node + k];
                r->error[PM_SOLID_DISPLACEMENT] += off * off;
            }
            for (int k = 0; k < 6 && !data->mesh.clamped[node]; ++k) {
                const double off = sigma[6 * node + k] - sigma_of[k];
                r->error[PM_SOLID_STRESS] += off * off;
            }
        }
        for (int k = 0; k < 2; ++k) {
            const double off = energy[k] - pm_solid_data_energy(data, i, j, k);
            r->error[PM_SOLID_STORED + k] += off * off;
        }
        if (to == NULL) {
            continue;
        }
        double *z = pm_field_state(to, row, j);
        const double *last = j > 0 ? pm_field_state(to, row, j - 1) : NULL;
        for (int node = 0; node < to->nnode; ++node, z += to->nvariable) {
            for (int k = 0; k < 3; ++k) {
                z[k] = to->position[3 * node + k] + own[3 * node + k];
                z[3 + k] = j == 0 ? 0 : (z[k] - last[(ptrdiff_t)node * to->nvariable + k]) / to->dt;
            }
            memcpy(z + 6, sigma + 6 * (ptrdiff_t)node, 6 * sizeof *z);
        }
        memcpy(pm_field_force(to, row, j), f, 3 * (size_t)to->nnode * sizeof *f);
        memcpy(to->energy + ((size_t)row * (size_t)to->ntime + (size_t)j) * PM_FIELD_ENERGIES,
               energy, sizeof energy);
    }
    r->work = energy[2];
    for (int k = 0; k < PM_SOLID_NSCORE; ++k) {
        r->error[k] = size[k] > 0 ? sqrt(r->error[k] / size[k]) : 0;
    }
    return PM_OK;
}

// Prints the lower quartile, median, upper quartile and maximum of each of the first errors, and
// how well both laws hold. `value` [count] is work space.
static void print_report(int nscore, int count, const response *r, double seconds, double *value) {
    static const char *const name[PM_SOLID_NSCORE] = {"displacement", "stress, free nodes",
                                                      "stored energy", "dissipated energy"};
    double residual = 0, least = INFINITY, off = 0;
    long steps = 0, iterations = 0, violations = 0;
    printf("Relative L2 errors over %d trajector%s, %%\n"
           "                       quartile   median quartile  largest\n",
           count, count == 1 ? "y" : "ies");
    for (int k = 0; k < nscore; ++k) {
        for (int i = 0; i < count; ++i) {
            value[i] = 100 * r[i].error[k];
        }
        const pm_box box = pm_box_of(count, value);
        printf("  %-20s %8.3f %8.3f %8.3f %8.3f\n", name[k], box.first_quartile, box.median,
               box.third_quartile, box.largest);
    }
    for (int i = 0; i < count; ++i) {
        residual = fmax(residual, r[i].energy_residual);
        least = fmin(least, r[i].least_heat);
        off = fmax(off, fabs(r[i].work / r[i].work_of_forces - 1));
        steps += r[i].steps;
        iterations += r[i].iterations;
        violations += r[i].violations;
    }
    printf("Both laws: largest residual of energy %.1e J, least heat %.1e J, %ld of %ld steps in "
           "violation\n",
           residual, least, violations, steps);
    printf("Work of the body and of the forces by the trapezoidal rule: %.2f %% apart at most\n",
           100 * off);
    printf("A step: %.1f ms of CPU time, %.1f iterations\n",
           1e3 * seconds / (double)(steps > 0 ? steps : 1),
           (double)iterations / (double)(steps > 0 ? steps : 1));
}

// Draws errors.png in `folder`, which it makes if it does not exist: a box for each of the first
// `nscore` errors, in %, over the trajectories r [count]. The numbers (errors.txt, a row for each
// trajectory) and the script for gnuplot stay beside the picture.
static pm_status plot_errors(int nscore, int count, const response *r, const char *folder) {
    static const char *const names[PM_SOLID_NSCORE] = {"displacement", "stress", "stored",
                                                       "dissipated"};
    FILE *file;
    PM_TRY(pm_python_folder(folder));
    PM_TRY(pm_python_table(&file, folder, "/errors.txt"));
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < nscore; ++k) {
            fprintf(file, "%.6g%s", 100 * r[i].error[k], k + 1 < nscore ? " " : "\n");
        }
    }
    PM_TRY(pm_python_table_close(file, folder));
    const char *argument[5 + PM_SOLID_NSCORE + 1] = {"boxes", folder, "per trajectory",
                                                     "errors.txt", ""};
    memcpy(argument + 5, names, (size_t)nscore * sizeof *argument);
    return pm_python_run(&pm_python_pictures, argument, false);
}

pm_status pm_command_respond(int argc, char **argv, const volatile sig_atomic_t *stop) {
    const char *fields = NULL, *weights = NULL, *trajectories = NULL, *plot = NULL, *output = NULL;
    const pm_option table[] = {
        {"--weights", "-w", "FILE", NULL, &weights, true,
         .help = "weights that `solid` has written"},
        {"--trajectories", NULL, "LIST", NULL, &trajectories, false,
         .help = "only these, such as 0:20 (not including 20), 0,3,6:9, or 40: (to the last)"},
        {"--plot", NULL, "DIR", NULL, &plot, false,
         .help = "draw box plots of the errors (gnuplot)"},
        {"--output", "-o", "FILE", NULL, &output, false,
         .help = "fields to write (HDF5, with XDMF)", .is_output = true, .kind = PM_FILES_HDF5},
    };
    const pm_options options = {
        .usage = "portmet-train respond FIELDS --weights FILE [options]",
        .summary =
            "Lets the forces of FIELDS act on a body of learned material on the mesh of FIELDS, "
            "and\n"
            "compares its displacements, stresses and energies with FIELDS. Checks both laws in\n"
            "every step.",
        .examples = "portmet-train respond fields.h5 --weights material.h5 -o learned.h5",
        .positional_name = "FIELDS",
        .positional = &fields,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_field *field = NULL, *to = NULL;
    pm_solid_data data;
    pm_solid_material material;
    pm_solid *solid = NULL;
    pm_arena arena = {0};
    pm_part part = {0};
    pm_provenance provenance;
    pm_status status;
    PM_TRY_DONE(pm_weights_load(weights, &arena, pm_component_of_part(&part), &provenance));
    if (pm_part_kind_of(&part) != PM_PART_SOLID) {
        PM_TRY_DONE(pm_fail(PM_EWEIGHTS, "%s: expected weights of a solid", weights));
    }
    PM_TRY_DONE(plot == NULL ? PM_OK : pm_python_check_pictures("boxes", plot));
    PM_TRY_DONE(pm_fields_check(output));
    pm_solid_material_read(part.spec.solid, &part.params, &material);
    PM_TRY_DONE(pm_field_load(&field, fields));
    PM_TRY_DONE(pm_solid_data_open(&data, field, &arena));
    PM_TRY_DONE(pm_options_list(trajectories, field->ntrajectory, data.trajectory, &data.count));
    PM_TRY_DONE(pm_solid_open(&solid, &data.mesh, &material));
    if (output != NULL) {
        const pm_field_shape shape = {.ntrajectory = data.count,
                                      .ntime = field->ntime,
                                      .nnode = field->nnode,
                                      .nvariable = PM_BODY_NVARIABLE,
                                      .nelement = field->nelement};
        PM_TRY_DONE(pm_field_new(&to, shape, field->dt, PM_BODY_VARIABLES));
        memcpy(to->position, field->position, 3 * (size_t)field->nnode * sizeof *to->position);
        memcpy(to->hexahedron, field->hexahedron,
               8 * (size_t)field->nelement * sizeof *to->hexahedron);
        for (int i = 0; i < field->nnode; ++i) {
            to->clamped[i] = data.mesh.clamped[i];
        }
    }
    const size_t nnode = (size_t)field->nnode, count = (size_t)data.count;
    const int nscore = field->energy == NULL ? PM_SOLID_STORED : PM_SOLID_NSCORE;
    response *r = pm_arena_array(&arena, count, sizeof *r);
    double *work = pm_arena_array(&arena, 9 * nnode + count, sizeof *work);
    PM_TRY_DONE(pm_arena_status(&arena, "the response of a body"));
    const clock_t start = clock();
    for (int i = 0; i < data.count; ++i) {
        PM_TRY_DONE(follow(&data, data.trajectory[i], solid, work, work + 3 * nnode, to, i, &r[i]));
        PM_TRY_DONE(*stop ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK);
    }
    const double seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    print_report(nscore, data.count, r, seconds, work + 9 * nnode);
    PM_TRY_DONE(plot == NULL ? PM_OK : plot_errors(nscore, data.count, r, plot));
    status = output == NULL ? PM_OK
                            : pm_fields_save(to, output, "Response of a learned body",
                                             "portmet-train respond", command);
done:
    pm_solid_close(solid);
    pm_part_free(&part);
    pm_field_free(to);
    pm_field_free(field);
    pm_arena_free(&arena);
    return status;
}
