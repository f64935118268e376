// portmet-train reconstruct: trajectories of modes or nodal values as fields of the body, and how
// far off they are.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "body/nodes.h"
#include "command/commands.h"
#include "command/options.h"
#include "modal/field_report.h"
#include "store/xdmf.h"

typedef struct arguments {
    const char *dataset, *basis, *body, *contact, *stiffness, *truth, *trajectories, *trained,
        *plot, *output;
} arguments;

static pm_status read_arguments(arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--basis", "-b", "FILE", NULL, &a->basis, false,
         "the basis that `reduce` made; without, DATASET has nodal values as of `nodes`"},
        {"--body", NULL, "NAME", NULL, &a->body, false, "of this body of an assembly (`contact`)"},
        {"--contact", NULL, "CONFIG", NULL, &a->contact, false,
         "what presses on that body: bodies placed as CONFIG says, as for `contact`"},
        {"--stiffness", NULL, "K", NULL, &a->stiffness, false,
         "N/m, of a pair of their facing points in the scene"},
        {"--truth", "-t", "FILE", NULL, &a->truth, false,
         "fields to score against, and whose forces there are (HDF5)"},
        {"--trajectories", NULL, "LIST", NULL, &a->trajectories, false,
         "the truth's trajectories that DATASET is about"},
        {"--trained", NULL, "LIST", NULL, &a->trained, false,
         "those of them that training saw: their errors apart"},
        {"--plot", NULL, "DIR", NULL, &a->plot, false, "draw box plots of the errors (gnuplot)"},
        {"--output", "-o", "FILE", NULL, &a->output, false, "write the fields (HDF5)"},
    };
    const pm_options options = {
        .usage = "portmet-train reconstruct DATASET {--basis FILE | --truth FILE} [options]",
        .summary =
            "Turns trajectories of modes, as of `reduce`, or of nodal values, as of `nodes`, both\n"
            "also as `evaluate --record` writes them, into fields of the body: positions,\n"
            "velocities, stresses; and prints their relative L2 errors per trajectory, stresses\n"
            "on free nodes. Modes need the --basis. Nodal values need the --truth, which knows\n"
            "the body, with all its states, whatever --relaxation `nodes` was given.",
        .positional_name = "DATASET",
        .positional = &a->dataset,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    return pm_options_read(&options, argc, argv, helped);
}

// What --contact needs.
static pm_status check_contact(const arguments *a, double *stiffness) {
    if ((a->contact == NULL) != (a->stiffness == NULL) || (a->contact != NULL && a->body == NULL)) {
        return pm_fail(PM_EUSAGE, "--contact, --stiffness and --body belong together");
    }
    return a->stiffness == NULL ? PM_OK
                                : pm_options_positive("--stiffness", a->stiffness, stiffness);
}

// Who else there is, and where the body touches them.
static pm_status find_touch(const arguments *a, double stiffness, const pm_dataset *modes,
                            pm_body_assembly *assembly, pm_contact_force *touch) {
    PM_TRY(pm_body_assembly_load(assembly, a->contact));
    int body = 0;
    while (body < assembly->nbody && strcmp(assembly->body[body].name, a->body) != 0) {
        ++body;
    }
    if (body == assembly->nbody) {
        return pm_fail(PM_EUSAGE, "--body: %s places no \"%s\"", a->contact, a->body);
    }
    return pm_contact_force_open(touch, assembly, body, modes, stiffness, &assembly->arena);
}

// The truth's trajectories named on the command line; as many as the dataset has.
static pm_status choose(const arguments *a, const pm_dataset *dataset, const pm_field *truth,
                        int **which) {
    int count = 0;
    *which = calloc((size_t)truth->ntrajectory, sizeof **which);
    if (*which == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a list of trajectories");
    }
    PM_TRY(pm_options_list(a->trajectories, truth->ntrajectory, *which, &count));
    return count == dataset->ntrajectory
               ? PM_OK
               : pm_fail(PM_EUSAGE, "%d trajectories in %s, %d of the truth (--trajectories)",
                         dataset->ntrajectory, a->dataset, count);
}

static pm_status make_from_nodes(const arguments *a, const pm_dataset *nodes, const pm_field *truth,
                                 const int *which, pm_field **field) {
    if (nodes->ntime != truth->ntime) {
        return pm_fail(PM_EDATA,
                       "%s: trajectories of %d states, those of %s have %d: only whole ones can be "
                       "made fields again (`nodes` without --states)",
                       a->dataset, nodes->ntime, a->truth, truth->ntime);
    }
    const pm_status status = pm_nodes_fields(field, nodes, truth, which);
    return status == PM_EDATA
               ? pm_fail(status, "%s as nodal values of %s: %s", a->dataset, a->truth, pm_error())
               : status;
}

static pm_status make_from_modes(const arguments *a, double stiffness, const pm_dataset *modes,
                                 const pm_field *truth, const int *which, pm_field **field) {
    pm_basis *basis = NULL;
    pm_body_assembly assembly = {0};
    pm_contact_force touch;
    pm_status status;
    PM_TRY_DONE(pm_basis_load(&basis, a->basis));
    PM_TRY_DONE(pm_basis_check(basis, pm_dataset_find_note(modes, "coordinates"), a->dataset));
    if (truth == NULL && basis->local.nsection > 0) {
        printf("without --truth forces are not known: stress close to loads is left out\n");
    }
    if (a->contact == NULL && truth != NULL && truth->contact != NULL) {
        printf("without --contact what other bodies do to the stress is left out\n");
    }
    if (a->contact != NULL) {
        assembly.basis = basis;
        PM_TRY_DONE(find_touch(a, stiffness, modes, &assembly, &touch));
    }
    PM_TRY_DONE(pm_reconstruct(field, basis, modes, a->body, a->contact == NULL ? NULL : &touch,
                               truth, which));
done:
    pm_arena_free(&assembly.arena);
    pm_basis_free(basis);
    return status;
}

static pm_status report_errors(const arguments *a, const pm_field *field, const pm_field *truth,
                               const int *which) {
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
            trained[i] = trained[i] || which[i] == seen[k];
        }
    }
    PM_TRY_DONE(pm_field_errors(field, truth, which, error));
    const pm_field_report report = {field->ntrajectory, error, trained};
    PM_TRY_DONE(pm_field_report_print(&report));
    status = a->plot == NULL ? PM_OK : pm_field_report_plot(&report, a->plot);
done:
    free(seen);
    free(trained);
    free(error);
    return status;
}

static pm_status save(const pm_field *field, const arguments *a, const char *command) {
    const char *const notes[][2] = {
        {"title", a->basis == NULL ? "Fields reconstructed from nodal values"
                                   : "Fields reconstructed from modes"},
        {"source", "portmet-train reconstruct"},
        {"command", command},
    };
    PM_TRY(pm_field_save(field, a->output, (int)(sizeof notes / sizeof *notes), notes));
    PM_TRY(field->nelement == 0 ? PM_OK : pm_xdmf_save(field, a->output)); // nothing to draw
    printf("wrote %s: %d trajectories of %d states, %d nodes\n", a->output, field->ntrajectory,
           field->ntime, field->nnode);
    return PM_OK;
}

pm_status pm_command_reconstruct(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    arguments a;
    memset(&a, 0, sizeof a);
    bool helped = false;
    double stiffness = 0;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    PM_TRY(check_contact(&a, &stiffness));
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_dataset *dataset = NULL;
    pm_field *field = NULL, *truth = NULL;
    int *which = NULL;
    pm_status status;
    if (a.basis == NULL && (a.truth == NULL || a.body != NULL)) {
        return pm_fail(PM_EUSAGE, "reconstruct: nodal values need --truth, modes a --basis");
    }
    PM_TRY_DONE(pm_dataset_load(&dataset, a.dataset));
    if (a.truth != NULL) {
        PM_TRY_DONE(pm_field_load(&truth, a.truth));
        PM_TRY_DONE(choose(&a, dataset, truth, &which));
    }
    PM_TRY_DONE(a.basis == NULL ? make_from_nodes(&a, dataset, truth, which, &field)
                                : make_from_modes(&a, stiffness, dataset, truth, which, &field));
    if (truth != NULL) {
        PM_TRY_DONE(report_errors(&a, field, truth, which));
    }
    status = a.output == NULL ? PM_OK : save(field, &a, command);
done:
    free(which);
    pm_field_free(truth);
    pm_field_free(field);
    pm_dataset_free(dataset);
    return status;
}
