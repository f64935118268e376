// portmet-train truth: simulates the trajectories that a configuration describes, and writes them.
#include "command/commands.h"
#include "command/truth_body.h"
#include "command/truth_noise.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "base/progress.h"
#include "store/dataset.h"
#include "truth/truth.h"

// Relative difference between two solutions below which a trajectory counts as converged.
#define CONVERGED 1e-10

typedef struct truth_arguments {
    const char *config, *output, *trajectories, *noise, *missing, *seed;
} truth_arguments;

static pm_status read_arguments(truth_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--output", "-o", "FILE", NULL, &a->output, true, "dataset to write (HDF5)"},
        {"--trajectories", NULL, "A:B", NULL, &a->trajectories, false,
         "only the trajectories from A up to, but not including, B"},
        {"--noise", NULL, "X", NULL, &a->noise, false,
         "add normal noise, X times the standard deviation of each column"},
        {"--missing", NULL, "X", NULL, &a->missing, false,
         "leave out the fraction X of the states at random, so that times are uneven"},
        {"--seed", NULL, "N", NULL, &a->seed, false,
         "seed of the noise and of the missing states; default: 1"},
    };
    const pm_options options = {
        .usage = "portmet-train truth CONFIG -o FILE [options]",
        .summary =
            "Simulates ground truth with SUNDIALS CVODE at the limit of double precision. Prints\n"
            "how far the result is converged, how well energy is conserved, and the smallest\n"
            "change of the entropy. Every trajectory has random numbers of its own: simulating a\n"
            "part of the trajectories gives the same numbers as simulating all. Bodies on a mesh\n"
            "are simulated with quasi-static finite elements, and their balance of energy is\n"
            "printed. Each body is written to a file of its own, with its name before the ending\n"
            "of FILE, and an XDMF file beside it, which ParaView opens.",
        .positional_name = "CONFIG",
        .positional = &a->config,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, helped));
    return pm_options_output("--output", a->output);
}

// Prints how well energy is conserved and how entropy grows.
static void print_report(const pm_truth *truth, const pm_truth_report *report) {
    const pm_truth_model *model = &truth->model;
    for (int k = 0; k < model->nconserved; ++k) {
        printf("%-17s drifts by %.1e of its largest value %.4g\n", model->conserved[k],
               report->magnitude[k] > 0 ? report->drift[k] / report->magnitude[k] : 0,
               report->magnitude[k]);
    }
    if (model->entropy != NULL) {
        printf("entropy           rises by %.4g J/K in the mean, smallest step %.1e J/K\n",
               report->entropy_rise, report->entropy_step);
    }
}

// Prints how far the trajectories are converged, and lists those beyond the tolerance by name.
static void print_convergence(int first, int count, const double *difference) {
    double worst = 0;
    int beyond = 0;
    for (int i = 0; i < count; ++i) {
        worst = fmax(worst, difference[i]);
        beyond += difference[i] > CONVERGED;
    }
    printf("convergence       %d of %d trajectories to %.0e, all to %.1e\n", count - beyond, count,
           CONVERGED, worst);
    for (int i = 0; i < count; ++i) {
        if (difference[i] > CONVERGED) {
            printf("                  trajectory %d amplifies errors: converged to %.1e\n",
                   first + i, difference[i]);
        }
    }
}

static pm_status note_convergence(pm_dataset *dataset, const double *difference) {
    const char *text = "";
    for (int i = 0; i < dataset->ntrajectory && text != NULL; ++i) {
        text = pm_arena_printf(&dataset->arena, "%s%s%.1e", text, i > 0 ? " " : "", difference[i]);
    }
    return text == NULL ? pm_fail(PM_ENOMEM, "truth: out of memory")
                        : pm_dataset_note(dataset, "convergence", "%s", text);
}

// Copies those components of the states z [ntime][nz] that are columns.
static void keep_columns(const pm_truth *truth, const double *z, pm_dataset *dataset,
                         int trajectory) {
    const size_t nz = (size_t)truth->model.ode.nz, ncolumn = (size_t)dataset->ncolumn;
    for (int j = 0; j < truth->ntime; ++j) {
        memcpy(pm_dataset_state(dataset, trajectory, j), z + (size_t)j * nz, ncolumn * sizeof *z);
    }
}

// Fills the dataset and `difference` [ntrajectory]; `z` and `check` [ntime][nz] are work space.
static pm_status run_all(const pm_truth *truth, int first, pm_dataset *dataset, double *difference,
                         double *z, double *check, const volatile sig_atomic_t *stop) {
    pm_truth_report report;
    pm_progress progress;
    pm_status status = PM_OK;
    pm_truth_report_init(&report);
    pm_progress_init(&progress, "truth", dataset->ntrajectory);
    for (int i = 0; i < dataset->ntrajectory && status == PM_OK; ++i) {
        status = *stop ? pm_fail(PM_EINTERRUPTED, "truth: interrupted, nothing written")
                       : pm_truth_run(truth, first + i, z, check);
        if (status == PM_OK) {
            pm_truth_report_add(&report, truth, z);
            difference[i] = pm_truth_difference(truth, z, check);
            keep_columns(truth, z, dataset, i);
            pm_progress_update(&progress, i + 1, NULL);
        }
    }
    pm_progress_finish(&progress);
    if (status == PM_OK) {
        print_report(truth, &report);
        print_convergence(first, dataset->ntrajectory, difference);
    }
    return status;
}

static pm_status simulate(const pm_truth *truth, int first, pm_dataset *dataset,
                          const volatile sig_atomic_t *stop) {
    const size_t nstate = (size_t)truth->ntime * (size_t)truth->model.ode.nz;
    double *difference = calloc((size_t)dataset->ntrajectory, sizeof *difference);
    double *z = calloc(nstate, sizeof *z), *check = calloc(nstate, sizeof *check);
    pm_status status = PM_OK;
    if (difference == NULL || z == NULL || check == NULL) {
        status = pm_fail(PM_ENOMEM, "truth: out of memory");
        goto done;
    }
    PM_TRY_DONE(run_all(truth, first, dataset, difference, z, check, stop));
    PM_TRY_DONE(note_convergence(dataset, difference));
done:
    free(difference);
    free(z);
    free(check);
    return status;
}

// Adds the noise of the command line and leaves out states.
static pm_status measure(const truth_arguments *a, pm_dataset *dataset, int first) {
    double noise = 0, missing = 0;
    int64_t seed = 1;
    PM_TRY(a->noise == NULL ? PM_OK : pm_options_positive("--noise", a->noise, &noise));
    PM_TRY(a->missing == NULL ? PM_OK : pm_options_positive("--missing", a->missing, &missing));
    PM_TRY(a->seed == NULL ? PM_OK : pm_options_count("--seed", a->seed, INT_MAX, &seed));
    return noise > 0 || missing > 0 ? pm_truth_add_noise(dataset, first, noise, missing, (int)seed)
                                    : PM_OK;
}

static pm_status add_notes(pm_dataset *dataset, const pm_truth *truth, int first,
                           const char *command) {
    PM_TRY(pm_dataset_note(dataset, "title", "%s", truth->model.title));
    PM_TRY(pm_dataset_note(dataset, "source", "portmet-train truth"));
    PM_TRY(pm_dataset_note(dataset, "command", "%s", command));
    PM_TRY(pm_dataset_note(dataset, "seed", "%llu", (unsigned long long)truth->seed));
    PM_TRY(pm_dataset_note(dataset, "parameters", "%s", truth->model.parameters));
    PM_TRY(pm_dataset_note(dataset, "units", "%s", truth->model.units));
    return pm_dataset_note(dataset, "first_trajectory", "%d", first);
}

pm_status pm_command_truth(int argc, char **argv, const volatile sig_atomic_t *stop) {
    truth_arguments a = {.output = NULL};
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_truth *truth = NULL;
    pm_dataset *dataset = NULL;
    pm_status status = PM_OK;
    int first = 0, end = 0;
    PM_TRY_DONE(pm_truth_load(&truth, a.config));
    PM_TRY_DONE(pm_options_range(a.trajectories, truth->ntrajectory, &first, &end));
    if (truth->model.body != NULL) {
        status = pm_truth_body_write(truth, first, end - first, command, a.output, stop);
        goto done;
    }
    PM_TRY_DONE(pm_dataset_new(&dataset, end - first, truth->ntime, truth->model.ncolumn, truth->dt,
                               truth->model.column));
    PM_TRY_DONE(add_notes(dataset, truth, first, command));
    PM_TRY_DONE(simulate(truth, first, dataset, stop));
    PM_TRY_DONE(measure(&a, dataset, first));
    PM_TRY_DONE(pm_dataset_save(dataset, a.output));
    printf("wrote %s: %d trajectories of %d states, %g s apart\n", a.output, end - first,
           truth->ntime, truth->dt);
done:
    pm_dataset_free(dataset);
    pm_truth_free(truth);
    return status;
}
