// portmet-train reconstruct: turns trajectories of modes or of nodal values into fields of the
// body, and scores them.
#include <stdio.h>
#include <string.h>

#include "base/files.h"
#include "base/options.h"
#include "base/python.h"
#include "bodies/bodies.h"
#include "bodies/command/fields.h"
#include "bodies/modal/contact_part.h"
#include "bodies/modal/reconstruct.h"
#include "bodies/solid/solid_nodes.h"
#include "sim/score.h"

typedef struct reconstruct_arguments {
    const char *dataset, *basis, *body, *contact, *weights, *truth, *trajectories, *trained, *plot,
        *output;
} reconstruct_arguments;

// --- errors ---

static const char *const names[PM_FIELD_NERROR] = {"displacement", "velocity", "stress"};

// The relative L2 errors of some trajectories.
typedef struct field_report {
    int count;
    const double *error; // [count][PM_FIELD_NERROR]
    const bool *trained; // [count] whether training saw the trajectory
} field_report;

// Prints whiskers, quartiles, medians and means, in %, of the trajectories that training saw, or
// did not see. `column` [count] is work space.
static void print_part(const field_report *r, bool trained, double *column) {
    int count = 0;
    for (int i = 0; i < r->count; ++i) {
        count += r->trained[i] == trained;
    }
    if (count == 0) {
        return;
    }
    printf("%-21s %9s %9s %9s %9s %9s %9s\n", trained ? "Trained on, %" : "Relative L2 error, %",
           "whisker", "quartile", "median", "quartile", "whisker", "mean");
    for (int e = 0; e < PM_FIELD_NERROR; ++e) {
        int at = 0;
        for (int i = 0; i < r->count; ++i) {
            if (r->trained[i] == trained) {
                column[at++] = r->error[i * PM_FIELD_NERROR + e];
            }
        }
        const pm_box b = pm_box_of(count, column);
        printf("  %-20s %9.3g %9.3g %9.3g %9.3g %9.3g %9.3g\n", names[e], 100 * b.low,
               100 * b.first_quartile, 100 * b.median, 100 * b.third_quartile, 100 * b.high,
               100 * b.mean);
    }
}

// Writes the errors in %, one row for each trajectory that training saw, or did not see.
static pm_status write_numbers(const field_report *r, const char *folder, bool trained) {
    FILE *file;
    PM_TRY(pm_python_table(&file, folder, trained ? "/trained.txt" : "/test.txt"));
    for (int i = 0; i < r->count; ++i) {
        const double *error = r->error + (ptrdiff_t)i * PM_FIELD_NERROR;
        if (r->trained[i] == trained) {
            fprintf(file, "%.6g %.6g %.6g\n", 100 * error[0], 100 * error[1], 100 * error[2]);
        }
    }
    return pm_python_table_close(file, folder);
}

// Makes `folder`, if it does not exist, and draws errors.png in it. Each quantity has a box for the
// trajectories that training did not see, and a pale box for those that it saw. A group without
// trajectories has no boxes. The script and the numbers stay in the folder.
static pm_status plot_errors(const field_report *r, const char *folder) {
    const char *const argument[] = {"boxes",
                                    folder,
                                    "per trajectory: train (pale), test",
                                    "test.txt",
                                    "trained.txt",
                                    names[0],
                                    names[1],
                                    "stress, free nodes",
                                    NULL};
    PM_TRY(pm_python_folder(folder));
    PM_TRY(write_numbers(r, folder, true));
    PM_TRY(write_numbers(r, folder, false));
    return pm_python_run(&pm_python_pictures, argument, false);
}

// --- fields ---

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
        // Place the bodies, find the contact interfaces of the one that is reconstructed, and read
        // their stiffness from the weights.
        PM_TRY_DONE(pm_body_assembly_load(&assembly, a->contact));
        int body = 0;
        while (body < assembly.nbody && strcmp(assembly.body[body].name, a->body) != 0) {
            ++body;
        }
        if (body == assembly.nbody) {
            PM_TRY_DONE(pm_fail(PM_EUSAGE, "--body: %s places no \"%s\"", a->contact, a->body));
        }
        double *stiffness =
            pm_arena_array(&assembly.arena, (size_t)assembly.ninterface, sizeof *stiffness);
        PM_TRY_DONE(pm_arena_status(&assembly.arena, "contact interfaces"));
        for (int i = 0; i < assembly.ninterface; ++i) {
            const pm_contact_interface *m = &assembly.interface[i];
            if (m->body[0] == body || m->body[1] == body) {
                PM_TRY_DONE(pm_contact_part_stiffness(&assembly, m, a->weights, &stiffness[i]));
            }
        }
        PM_TRY_DONE(
            pm_contact_force_open(&force, &assembly, body, modes, stiffness, &assembly.arena));
    }
    PM_TRY_DONE(pm_reconstruct(field, basis, modes, a->body, a->contact == NULL ? NULL : &force,
                               truth, trajectory));
done:
    pm_arena_free(&assembly.arena);
    pm_basis_free(basis);
    return status;
}

pm_status pm_command_reconstruct(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    reconstruct_arguments a;
    memset(&a, 0, sizeof a);
    const pm_option table[] = {
        {"--basis", "-b", "FILE", NULL, &a.basis, false,
         .help = "the basis that `reduce` made; without it DATASET has nodal values"},
        {"--body", NULL, "NAME", NULL, &a.body, false,
         .help = "reconstruct this body of an assembly, whose dataset `contact` wrote"},
        {"--contact", NULL, "CONFIG", NULL, &a.contact, false,
         .help = "add the stress that other bodies cause, placed as CONFIG says"},
        {"--weights", "-w", "DIR", NULL, &a.weights, false,
         .help = "the weights that `contact` wrote, which contain the stiffness of the contact"},
        {"--truth", "-t", "FILE", NULL, &a.truth, false,
         .help = "fields to score against, which also contain the loads on the nodes (HDF5)"},
        {"--trajectories", NULL, "LIST", NULL, &a.trajectories, false,
         .help = "the trajectories of the truth to which those of DATASET belong"},
        {"--trained", NULL, "LIST", NULL, &a.trained, false,
         .help = "report the errors of these trajectories separately, because training saw them"},
        {"--plot", NULL, "DIR", NULL, &a.plot, false,
         .help = "draw box plots of the errors (gnuplot)"},
        {"--output", "-o", "FILE", NULL, &a.output, false, .help = "write the fields (HDF5)",
         .is_output = true, .kind = PM_FILES_HDF5},
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
        .examples =
            "portmet-train reconstruct predicted.h5 --basis reduced/basis.h5 --truth beam.h5",
        .positional_name = "DATASET",
        .positional = &a.dataset,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    if (a.basis == NULL && a.truth == NULL) {
        return pm_fail(PM_EUSAGE, "reconstruct: nodal values need --truth, modes a --basis");
    }
    if ((a.contact == NULL) != (a.weights == NULL) || (a.contact != NULL && a.body == NULL)) {
        return pm_fail(PM_EUSAGE, "reconstruct: --contact, --weights and --body belong together");
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_dataset *dataset = NULL;
    pm_field *field = NULL, *truth = NULL;
    pm_arena arena = {0};
    int count = 0, *trajectory = NULL;
    pm_status status;
    PM_TRY_DONE(pm_dataset_load(&dataset, a.dataset));
    if (a.truth != NULL) {
        PM_TRY_DONE(pm_field_load(&truth, a.truth));
        PM_TRY_DONE(
            pm_trajectories_list(a.trajectories, truth->ntrajectory, &arena, &trajectory, &count));
        if (count != dataset->ntrajectory) {
            PM_TRY_DONE(pm_fail(PM_EUSAGE,
                                "trajectories: %d in %s, %d of the truth (--trajectories)",
                                dataset->ntrajectory, a.dataset, count));
        }
    }
    PM_TRY_DONE(a.plot == NULL ? PM_OK : pm_python_check_pictures("boxes", a.plot));
    PM_TRY_DONE(pm_fields_check(a.output));
    if (a.basis != NULL) {
        PM_TRY_DONE(make_from_modes(&a, dataset, truth, trajectory, &field));
    } else if (dataset->ntime != truth->ntime) {
        PM_TRY_DONE(
            pm_fail(PM_EDATA,
                    "%s: trajectories of %d states, those of %s have %d: only whole trajectories "
                    "can become fields again (`nodes` without --states)",
                    a.dataset, dataset->ntime, a.truth, truth->ntime));
    } else if (!pm_solid_nodes_fit(dataset, a.body, truth)) {
        const char *body = a.body == NULL ? "" : a.body, *join = a.body == NULL ? "" : "_";
        PM_TRY_DONE(pm_fail(PM_EDATA,
                            "%s as nodal values of %s: expected columns %s%su[0:%d] and "
                            "%s%ssigma[0:%d]",
                            a.dataset, a.truth, body, join, 3 * truth->nnode, body, join,
                            6 * truth->nnode));
    } else {
        PM_TRY_DONE(pm_solid_nodes_fields(&field, dataset, a.body, truth, trajectory));
    }
    if (truth != NULL) {
        double *error = pm_arena_array(&arena, (size_t)count, PM_FIELD_NERROR * sizeof *error);
        double *column = pm_arena_array(&arena, (size_t)count + 1, sizeof *column);
        bool *trained = pm_arena_array(&arena, (size_t)count, sizeof *trained);
        const field_report report = {count, error, trained};
        int *seen, nseen = 0;
        PM_TRY_DONE(pm_arena_status(&arena, "errors"));
        if (a.trained != NULL) {
            PM_TRY_DONE(pm_trajectories_list(a.trained, truth->ntrajectory, &arena, &seen, &nseen));
        }
        for (int i = 0; i < count * nseen; ++i) {
            trained[i / nseen] = trained[i / nseen] || trajectory[i / nseen] == seen[i % nseen];
        }
        PM_TRY_DONE(pm_field_errors(field, truth, trajectory, error));
        print_part(&report, false, column);
        print_part(&report, true, column);
        PM_TRY_DONE(a.plot == NULL ? PM_OK : plot_errors(&report, a.plot));
    }
    status = a.output == NULL
                 ? PM_OK
                 : pm_fields_save(field, a.output,
                                  a.basis == NULL ? "Fields reconstructed from nodal values"
                                                  : "Fields reconstructed from modes",
                                  "portmet-train reconstruct", command);
done:
    pm_arena_free(&arena);
    pm_field_free(truth);
    pm_field_free(field);
    pm_dataset_free(dataset);
    return status;
}
