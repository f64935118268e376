// portmet-train reconstruct: turns trajectories of modes or of nodal values into fields of the
// body, and scores them.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "body/solid_nodes.h"
#include "command/commands.h"
#include "command/save_fields.h"
#include "modal/contact_part.h"
#include "modal/field_report.h"

typedef struct reconstruct_arguments {
    const char *dataset, *basis, *body, *contact, *weights, *truth, *trajectories, *trained, *plot,
        *output;
} reconstruct_arguments;

static pm_status read_arguments(reconstruct_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--basis", "-b", "FILE", NULL, &a->basis, false,
         "the basis that `reduce` made; without it DATASET has nodal values"},
        {"--body", NULL, "NAME", NULL, &a->body, false,
         "reconstruct this body of an assembly, whose dataset `contact` wrote"},
        {"--contact", NULL, "CONFIG", NULL, &a->contact, false,
         "add the stress that other bodies cause, placed as CONFIG says"},
        {"--weights", "-w", "DIR", NULL, &a->weights, false,
         "the weights that `contact` wrote, which contain the stiffness of the contact"},
        {"--truth", "-t", "FILE", NULL, &a->truth, false,
         "fields to score against, which also contain the loads on the nodes (HDF5)"},
        {"--trajectories", NULL, "LIST", NULL, &a->trajectories, false,
         "the trajectories of the truth to which those of DATASET belong"},
        {"--trained", NULL, "LIST", NULL, &a->trained, false,
         "report the errors of these trajectories separately, because training saw them"},
        {"--plot", NULL, "DIR", NULL, &a->plot, false, "draw box plots of the errors (gnuplot)"},
        {"--output", "-o", "FILE", NULL, &a->output, false, "write the fields (HDF5)"},
    };
    const pm_options options = {
        .usage = "portmet-train reconstruct DATASET {--basis FILE | --truth FILE} [options]",
        .summary =
            "Turns trajectories of modes, which `reduce` writes, or of nodal values, which "
            "`nodes`\n"
            "writes, into fields of the body: positions, velocities, stresses. Recordings of\n"
            "`evaluate --record` work as well. Prints the relative L2 errors per trajectory;\n"
            "stresses are compared on the free nodes. Modes need the option --basis. Nodal values\n"
            "need the option --truth, which describes the body, and as many states as the truth\n"
            "has.",
        .positional_name = "DATASET",
        .positional = &a->dataset,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, helped));
    return pm_options_output("--output", a->output);
}

static pm_status check_arguments(const reconstruct_arguments *a) {
    if (a->basis == NULL && a->truth == NULL) {
        return pm_fail(PM_EUSAGE, "reconstruct: nodal values need --truth, modes a --basis");
    }
    return (a->contact == NULL) == (a->weights == NULL) && (a->contact == NULL || a->body != NULL)
               ? PM_OK
               : pm_fail(PM_EUSAGE, "reconstruct: --contact, --weights and --body belong together");
}

// Places the bodies, finds the contact interfaces of the one that is reconstructed, and reads their
// stiffness from the weights.
static pm_status open_contact(const reconstruct_arguments *a, const pm_dataset *modes,
                              pm_body_assembly *assembly, pm_contact_force *force) {
    PM_TRY(pm_body_assembly_load(assembly, a->contact));
    int body = 0;
    while (body < assembly->nbody && strcmp(assembly->body[body].name, a->body) != 0) {
        ++body;
    }
    if (body == assembly->nbody) {
        return pm_fail(PM_EUSAGE, "--body: %s places no \"%s\"", a->contact, a->body);
    }
    double *stiffness =
        pm_arena_array(&assembly->arena, (size_t)assembly->ninterface, sizeof *stiffness);
    if (stiffness == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for contact interfaces");
    }
    for (int i = 0; i < assembly->ninterface; ++i) {
        const pm_contact_interface *m = &assembly->interface[i];
        if (m->body[0] == body || m->body[1] == body) {
            PM_TRY(pm_contact_part_stiffness(assembly, m, a->weights, &stiffness[i]));
        }
    }
    return pm_contact_force_open(force, assembly, body, modes, stiffness, &assembly->arena);
}

// Lists the trajectories of the truth that the command line names; the dataset must have as many.
static pm_status choose(const reconstruct_arguments *a, const pm_dataset *dataset,
                        const pm_field *truth, int **trajectory) {
    int count = 0;
    *trajectory = calloc((size_t)truth->ntrajectory, sizeof **trajectory);
    if (*trajectory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a list of trajectories");
    }
    PM_TRY(pm_options_list(a->trajectories, truth->ntrajectory, *trajectory, &count));
    return count == dataset->ntrajectory
               ? PM_OK
               : pm_fail(PM_EUSAGE, "%d trajectories in %s, %d of the truth (--trajectories)",
                         dataset->ntrajectory, a->dataset, count);
}

static pm_status make_from_nodes(const reconstruct_arguments *a, const pm_dataset *nodes,
                                 const pm_field *truth, const int *trajectory, pm_field **field) {
    if (nodes->ntime != truth->ntime) {
        return pm_fail(
            PM_EDATA,
            "%s: trajectories of %d states, those of %s have %d: only whole trajectories "
            "can become fields again (`nodes` without --states)",
            a->dataset, nodes->ntime, a->truth, truth->ntime);
    }
    const char *body = a->body == NULL ? "" : a->body, *join = a->body == NULL ? "" : "_";
    return pm_solid_nodes_fit(nodes, a->body, truth)
               ? pm_solid_nodes_fields(field, nodes, a->body, truth, trajectory)
               : pm_fail(PM_EDATA,
                         "%s as nodal values of %s: expected columns %s%su[0:%d] and "
                         "%s%ssigma[0:%d]",
                         a->dataset, a->truth, body, join, 3 * truth->nnode, body, join,
                         6 * truth->nnode);
}

static pm_status make_from_modes(const reconstruct_arguments *a, const pm_dataset *modes,
                                 const pm_field *truth, const int *trajectory, pm_field **field) {
    pm_basis *basis = NULL;
    pm_body_assembly assembly = {0};
    pm_contact_force force;
    pm_status status;
    PM_TRY_DONE(pm_basis_load(&basis, a->basis));
    PM_TRY_DONE(pm_basis_check(basis, pm_dataset_find_note(modes, "coordinates"), a->dataset));
    if (truth == NULL && basis->local.nsection > 0) {
        printf("without --truth the loads on the nodes are not known: the stress close to them is "
               "left out\n");
    }
    if (a->contact == NULL && truth != NULL && truth->contact != NULL) {
        printf("without --contact the stress that other bodies cause is left out\n");
    }
    if (a->contact != NULL) {
        assembly.basis = basis;
        PM_TRY_DONE(open_contact(a, modes, &assembly, &force));
    }
    PM_TRY_DONE(pm_reconstruct(field, basis, modes, a->body, a->contact == NULL ? NULL : &force,
                               truth, trajectory));
done:
    pm_arena_free(&assembly.arena);
    pm_basis_free(basis);
    return status;
}

static pm_status report_errors(const reconstruct_arguments *a, const pm_field *field,
                               const pm_field *truth, const int *trajectory) {
    const size_t count = (size_t)field->ntrajectory;
    double *error = calloc(count, PM_FIELD_NERROR * sizeof *error);
    bool *trained = calloc(count, sizeof *trained);
    int *seen = calloc((size_t)truth->ntrajectory, sizeof *seen), nseen = 0;
    pm_status status;
    if (error == NULL || trained == NULL || seen == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for errors");
        goto done;
    }
    if (a->trained != NULL) {
        PM_TRY_DONE(pm_options_list(a->trained, truth->ntrajectory, seen, &nseen));
    }
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < nseen; ++k) {
            trained[i] = trained[i] || trajectory[i] == seen[k];
        }
    }
    PM_TRY_DONE(pm_field_errors(field, truth, trajectory, error));
    const pm_field_report report = {field->ntrajectory, error, trained};
    PM_TRY_DONE(pm_field_report_print(&report));
    status = a->plot == NULL ? PM_OK : pm_field_report_plot(&report, a->plot);
done:
    free(seen);
    free(trained);
    free(error);
    return status;
}

pm_status pm_command_reconstruct(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    reconstruct_arguments a;
    memset(&a, 0, sizeof a);
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    PM_TRY(check_arguments(&a));
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_dataset *dataset = NULL;
    pm_field *field = NULL, *truth = NULL;
    int *trajectory = NULL;
    pm_status status;
    PM_TRY_DONE(pm_dataset_load(&dataset, a.dataset));
    if (a.truth != NULL) {
        PM_TRY_DONE(pm_field_load(&truth, a.truth));
        PM_TRY_DONE(choose(&a, dataset, truth, &trajectory));
    }
    PM_TRY_DONE(a.basis == NULL ? make_from_nodes(&a, dataset, truth, trajectory, &field)
                                : make_from_modes(&a, dataset, truth, trajectory, &field));
    if (truth != NULL) {
        PM_TRY_DONE(report_errors(&a, field, truth, trajectory));
    }
    status = a.output == NULL
                 ? PM_OK
                 : pm_fields_save(field, a.output,
                                  a.basis == NULL ? "Fields reconstructed from nodal values"
                                                  : "Fields reconstructed from modes",
                                  "portmet-train reconstruct", command);
done:
    free(trajectory);
    pm_field_free(truth);
    pm_field_free(field);
    pm_dataset_free(dataset);
    return status;
}
