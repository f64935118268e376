// portmet-train truth: simulates the trajectories that a configuration describes, and writes them.
#include "command/commands.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/options.h"
#include "base/progress.h"
#include "base/rng.h"
#include "store/dataset.h"
#include "truth/truth.h"

// Relative difference between two solutions below which a trajectory counts as converged.
#define CONVERGED 1e-10

// Fills the dataset. Prints how well energy is conserved, how entropy grows, and how far the
// trajectories are converged, which it also notes; names those beyond the tolerance.
static pm_status simulate(const pm_truth *truth, int first, pm_dataset *dataset,
                          const volatile sig_atomic_t *stop) {
    const pm_truth_model *model = &truth->model;
    const size_t nz = (size_t)model->ode.nz, ncolumn = (size_t)dataset->ncolumn;
    const int count = dataset->ntrajectory;
    double *difference = calloc((size_t)count, sizeof *difference);
    double *z = calloc((size_t)truth->ntime * nz, sizeof *z);
    double *check = calloc((size_t)truth->ntime * nz, sizeof *check);
    const char *text = "";
    double worst = 0;
    int beyond = 0;
    pm_truth_report report;
    pm_progress progress;
    pm_status status = PM_OK;
    if (difference == NULL || z == NULL || check == NULL) {
        PM_TRY_DONE(pm_fail(PM_ENOMEM, "truth: out of memory"));
    }
    pm_truth_report_init(&report);
    pm_progress_init(&progress, "truth", count);
    for (int i = 0; i < dataset->ntrajectory && status == PM_OK; ++i) {
        status = *stop ? pm_fail(PM_EINTERRUPTED, "truth: interrupted, nothing written")
                       : pm_truth_run(truth, first + i, z, check);
        if (status == PM_OK) {
            pm_truth_report_add(&report, truth, z);
            difference[i] = pm_truth_difference(truth, z, check);
            for (int j = 0; j < truth->ntime; ++j) { // those components that are columns
                memcpy(pm_dataset_state(dataset, i, j), z + (size_t)j * nz, ncolumn * sizeof *z);
            }
            pm_progress_update(&progress, i + 1, NULL);
        }
    }
    pm_progress_finish(&progress);
    PM_TRY_DONE(status);
    for (int k = 0; k < model->nconserved; ++k) {
        printf("%-17s drifts by %.1e of its largest value %.4g\n", model->conserved[k],
               report.magnitude[k] > 0 ? report.drift[k] / report.magnitude[k] : 0,
               report.magnitude[k]);
    }
    if (model->entropy != NULL) {
        printf("entropy           rises by %.4g J/K in the mean, smallest step %.1e J/K\n",
               report.entropy_rise, report.entropy_step);
    }
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
    for (int i = 0; i < dataset->ntrajectory && text != NULL; ++i) {
        text = pm_arena_printf(&dataset->arena, "%s%s%.1e", text, i > 0 ? " " : "", difference[i]);
    }
    PM_TRY_DONE(pm_arena_status(&dataset->arena, "a note"));
    status = pm_dataset_note(dataset, "convergence", "%s", text);
done:
    free(difference);
    free(z);
    free(check);
    return status;
}

// --- synthetic measurements ---

// Adds normally distributed noise to every column. Its standard deviation is `noise` times that of
// the column over all trajectories. The result depends on the seed and on the number of each
// trajectory, which is `first` for the first one.
static pm_status add_noise(pm_dataset *d, int first, double noise, int64_t seed) {
    const size_t n = (size_t)d->ntrajectory * (size_t)d->ntime, ncolumn = (size_t)d->ncolumn;
    double *deviation = pm_arena_array(&d->arena, ncolumn, sizeof *deviation);
    PM_TRY(pm_arena_status(&d->arena, "noise"));
    for (size_t c = 0; c < ncolumn; ++c) {
        double mean = 0, square = 0;
        for (size_t i = 0; i < n; ++i) {
            mean += d->z[i * ncolumn + c] / (double)n;
        }
        for (size_t i = 0; i < n; ++i) {
            const double x = d->z[i * ncolumn + c] - mean;
            square += x * x / (double)n;
        }
        deviation[c] = sqrt(square);
    }
    for (int i = 0; i < d->ntrajectory; ++i) {
        pm_rng rng;
        pm_rng_init(&rng, (uint64_t)seed, 2 * (uint64_t)(first + i));
        for (int j = 0; j < d->ntime; ++j) {
            double *state = pm_dataset_state(d, i, j);
            for (size_t c = 0; c < ncolumn; ++c) {
                state[c] += noise * deviation[c] * pm_rng_normal(&rng);
            }
        }
    }
    return PM_OK;
}

// Leaves out the fraction `missing` of all states at random, so that the remaining times are
// uneven. The first two that are left of a trajectory stay in any case.
static pm_status leave_out(pm_dataset *d, int first, double missing, int64_t seed) {
    const size_t n = (size_t)d->ntrajectory * (size_t)d->ntime;
    d->measured = true;
    d->times = pm_arena_array(&d->arena, n, sizeof *d->times);
    PM_TRY(pm_arena_status(&d->arena, "times"));
    for (int i = 0; i < d->ntrajectory; ++i) {
        pm_rng rng;
        pm_rng_init(&rng, (uint64_t)seed, 2 * (uint64_t)(first + i) + 1);
        double *t = d->times + (size_t)i * (size_t)d->ntime;
        int kept = 0;
        for (int j = 0; j < d->ntime; ++j) {
            if (pm_rng_uniform(&rng) >= missing || kept + d->ntime - j <= 2) {
                t[kept] = d->t[j];
                memmove(pm_dataset_state(d, i, kept++), pm_dataset_state(d, i, j),
                        (size_t)d->ncolumn * sizeof(double));
            }
        }
        for (int j = kept; j < d->ntime; ++j) {
            t[j] = NAN;
            for (int c = 0; c < d->ncolumn; ++c) {
                pm_dataset_state(d, i, j)[c] = NAN;
            }
        }
    }
    return PM_OK;
}

pm_status pm_command_truth(const pm_truth_simulator *more, int argc, char **argv,
                           const volatile sig_atomic_t *stop) {
    const char *config = NULL, *output = NULL, *trajectories = NULL;
    double noise = 0, missing = 0;
    int64_t seed = 1;
    const pm_option table[] = {
        {"--output", "-o", "FILE", NULL, &output, true, .help = "dataset to write (HDF5)",
         .is_output = true, .kind = PM_FILES_HDF5},
        {"--trajectories", NULL, "A:B", NULL, &trajectories, false,
         .help = "only the trajectories from A up to, but not including, B"},
        {"--noise", NULL, "X", .positive = &noise,
         .help = "add normal noise, X times the standard deviation of each column"},
        {"--missing", NULL, "X", .positive = &missing,
         .help = "leave out the fraction X of the states at random, so that times are uneven"},
        {"--seed", NULL, "N", .count = &seed, .least = 1, .most = INT_MAX,
         .help = "seed of the noise and of the missing states; default: 1"},
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
        .examples = "portmet-train truth configs/truth/double_pendulum.yaml -o pendula.h5",
        .positional_name = "CONFIG",
        .positional = &config,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_truth *truth = NULL;
    pm_dataset *dataset = NULL;
    pm_status status = PM_OK;
    int first = 0, end = 0;
    PM_TRY_DONE(pm_truth_load(&truth, config, more));
    PM_TRY_DONE(pm_options_range(trajectories, truth->ntrajectory, &first, &end));
    if (truth->simulator->write != NULL) {
        status = truth->simulator->write(truth, first, end - first, command, output, stop);
        goto done;
    }
    PM_TRY_DONE(pm_dataset_new(&dataset, end - first, truth->ntime, truth->model.ncolumn, truth->dt,
                               truth->model.column));
    PM_TRY_DONE(pm_dataset_note(dataset, "title", "%s", truth->model.title));
    PM_TRY_DONE(pm_dataset_note(dataset, "source", "portmet-train truth"));
    PM_TRY_DONE(pm_dataset_note(dataset, "command", "%s", command));
    PM_TRY_DONE(pm_dataset_note(dataset, "seed", "%llu", (unsigned long long)truth->seed));
    PM_TRY_DONE(pm_dataset_note(dataset, "parameters", "%s", truth->model.parameters));
    PM_TRY_DONE(pm_dataset_note(dataset, "units", "%s", truth->model.units));
    PM_TRY_DONE(pm_dataset_note(dataset, "first_trajectory", "%d", first));
    PM_TRY_DONE(simulate(truth, first, dataset, stop));
    if (noise > 0 || missing > 0) {
        PM_TRY_DONE(add_noise(dataset, first, noise, seed));
    }
    if (missing > 0) {
        PM_TRY_DONE(leave_out(dataset, first, missing, seed));
    }
    PM_TRY_DONE(pm_dataset_save(dataset, output));
    printf("wrote %s: %d trajector%s of %d states, %g s apart\n", output, end - first,
           end - first == 1 ? "y" : "ies", truth->ntime, truth->dt);
done:
    pm_dataset_free(dataset);
    pm_truth_free(truth);
    return status;
}
