// portmet-train respond: computes how a body of learned material responds to forces.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/options.h"
#include "body/solid_plot.h"
#include "command/commands.h"
#include "command/save_fields.h"
#include "scene/weights.h"
#include "sim/score.h"

typedef struct respond_arguments {
    const char *fields, *weights, *trajectories, *plot, *output;
} respond_arguments;

static pm_status read_arguments(respond_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--weights", "-w", "FILE", NULL, &a->weights, true, "weights that `solid` has written"},
        {"--trajectories", NULL, "LIST", NULL, &a->trajectories, false,
         "only these, such as 0:20 (not including 20), 0,3,6:9, or 40: (to the last)"},
        {"--plot", NULL, "DIR", NULL, &a->plot, false, "draw box plots of the errors (gnuplot)"},
        {"--output", "-o", "FILE", NULL, &a->output, false, "fields to write (HDF5, with XDMF)"},
    };
    const pm_options options = {
        .usage = "portmet-train respond FIELDS --weights FILE [options]",
        .summary =
            "Lets the forces of FIELDS act on a body of learned material on the mesh of FIELDS, "
            "and\n"
            "compares its displacements, stresses and energies with FIELDS. Checks both laws in\n"
            "every step.",
        .positional_name = "FIELDS",
        .positional = &a->fields,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, helped));
    return pm_options_output("--output", a->output);
}

// Prints the lower quartile, median, upper quartile and maximum of each of the first errors.
// `value` [count] is work space.
static void print_errors(int nscore, int count, const pm_solid_response *r, double *value) {
    static const char *const name[PM_SOLID_NSCORE] = {"displacement", "stress, free nodes",
                                                      "stored energy", "dissipated energy"};
    printf("Relative L2 errors over %d trajectories, %%\n"
           "                       quartile   median quartile  largest\n",
           count);
    for (int k = 0; k < nscore; ++k) {
        for (int i = 0; i < count; ++i) {
            value[i] = 100 * r[i].error[k];
        }
        const pm_box box = pm_box_of(count, value);
        printf("  %-20s %8.3f %8.3f %8.3f %8.3f\n", name[k], box.first_quartile, box.median,
               box.third_quartile, box.largest);
    }
}

static void print_laws(int count, const pm_solid_response *r, double seconds) {
    double residual = 0, least = INFINITY, off = 0;
    long steps = 0, iterations = 0, violations = 0;
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

// Makes fields like those of the data, to be filled.
static pm_status make_fields(const pm_solid_data *data, pm_field **to) {
    const pm_field *field = data->field;
    const pm_field_shape shape = {.ntrajectory = data->count,
                                  .ntime = field->ntime,
                                  .nnode = field->nnode,
                                  .nvariable = 12,
                                  .nelement = field->nelement};
    PM_TRY(pm_field_new(to, shape, field->dt, "qx qy qz vx vy vz sxx syy szz sxy sxz syz"));
    memcpy((*to)->position, field->position, 3 * (size_t)field->nnode * sizeof *field->position);
    memcpy((*to)->hexahedron, field->hexahedron,
           8 * (size_t)field->nelement * sizeof *field->hexahedron);
    for (int i = 0; i < field->nnode; ++i) {
        (*to)->clamped[i] = data->mesh.clamped[i];
    }
    return PM_OK;
}

static pm_status respond(const pm_solid_data *data, pm_solid *solid, pm_field *to, const char *plot,
                         const volatile sig_atomic_t *stop) {
    const size_t nnode = (size_t)data->field->nnode, count = (size_t)data->count;
    pm_solid_response *r = calloc(count, sizeof *r);
    double *work = calloc(9 * nnode + count, sizeof *work);
    pm_status status = r == NULL || work == NULL ? pm_fail(PM_ENOMEM, "out of memory") : PM_OK;
    const clock_t start = clock();
    for (int i = 0; i < data->count && status == PM_OK; ++i) {
        status = pm_solid_respond(data, data->trajectory[i], solid, work, work + 3 * nnode, to, i,
                                  &r[i]);
        if (status == PM_OK && *stop) {
            status = pm_fail(PM_EINTERRUPTED, "interrupted");
        }
    }
    if (status == PM_OK) {
        const int nscore = data->field->energy == NULL ? PM_SOLID_STORED : PM_SOLID_NSCORE;
        print_errors(nscore, data->count, r, work + 9 * nnode);
        print_laws(data->count, r, (double)(clock() - start) / CLOCKS_PER_SEC);
        status = plot == NULL ? PM_OK : pm_solid_plot(nscore, data->count, r, plot);
    }
    free(work);
    free(r);
    return status;
}

// Loads weights of a solid.
static pm_status load_material(const char *path, pm_arena *arena, pm_part *part,
                               pm_solid_material *material) {
    pm_provenance provenance;
    PM_TRY(pm_weights_load_part(path, arena, part, &provenance));
    if (part->spec.solid == NULL) {
        return pm_fail(PM_EWEIGHTS, "%s: expected weights of a solid", path);
    }
    pm_solid_material_read(part->spec.solid, &part->params, material);
    return PM_OK;
}

pm_status pm_command_respond(int argc, char **argv, const volatile sig_atomic_t *stop) {
    respond_arguments a = {0};
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_field *field = NULL, *to = NULL;
    pm_solid_data data;
    pm_solid_material material;
    pm_solid *solid = NULL;
    pm_arena arena = {0};
    pm_part part = {0};
    pm_status status;
    PM_TRY_DONE(load_material(a.weights, &arena, &part, &material));
    PM_TRY_DONE(pm_field_load(&field, a.fields));
    PM_TRY_DONE(pm_solid_data_open(&data, field, &arena));
    PM_TRY_DONE(pm_options_list(a.trajectories, field->ntrajectory, data.trajectory, &data.count));
    PM_TRY_DONE(pm_solid_open(&solid, &data.mesh, &material));
    if (a.output != NULL) {
        PM_TRY_DONE(make_fields(&data, &to));
    }
    PM_TRY_DONE(respond(&data, solid, to, a.plot, stop));
    status = a.output == NULL ? PM_OK
                              : pm_fields_save(to, a.output, "Response of a learned body",
                                               "portmet-train respond", command);
done:
    pm_solid_close(solid);
    pm_part_free(&part);
    pm_field_free(to);
    pm_field_free(field);
    pm_arena_free(&arena);
    return status;
}
