// portmet-train evaluate: rolls out a scene from the first state of each trajectory of a dataset
// and prints errors, the balance of energy, and the growth of entropy.
#include "command/commands.h"
#include "command/evaluate_estimate.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/files.h"
#include "base/options.h"
#include "base/progress.h"
#include "base/python.h"
#include "command/tables.h"
#include "data/unit_change.h"
#include "evaluate/evaluate.h"
#include "evaluate/evaluate_plot.h"
#include "evaluate/evaluate_report.h"
#include "evaluate/thermo.h"

#define MOST_THREADS 16
#define ROUNDING 1e-9 // relative: a time that is so close to a step belongs to it

static void show_progress(void *context, int rollout) {
    pm_progress_update(context, rollout, NULL);
}

// The objects of an evaluation, all owned by the command.
typedef struct job {
    pm_scene *scene;
    pm_system *system;
    pm_dataset *truth;
    bool *seen; // [ntrajectory] used in training
    bool known; // whether the weights have digests of those they have seen
    int *which; // [ntrajectory] work space
    pm_evaluation *evaluation, *trained;
    pm_thermo thermo;
    const volatile sig_atomic_t *stop;
} job;

// Rolls out the trajectories which [count].
static pm_status roll_out(pm_evaluation **evaluation, const job *j, int count) {
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    pm_progress progress;
    const pm_evaluate_how how = {
        .threads = processors > 0 && processors < MOST_THREADS ? (int)processors : MOST_THREADS,
        .stop = j->stop,
        .progress = show_progress,
        .context = &progress,
    };
    pm_progress_init(&progress, "evaluate", count);
    const pm_status status =
        pm_evaluate_list(evaluation, j->system, j->truth, count, j->which, &how);
    pm_progress_finish(&progress);
    return status;
}

static pm_status evaluate(job *j, const pm_evaluate_arguments *a) {
    PM_TRY(pm_dataset_load(&j->truth, a->data));
    PM_TRY(pm_unit_change_apply(j->scene, j->truth, !a->json));
    PM_TRY(pm_system_check_dataset(j->system, j->truth, a->data));
    const size_t n = (size_t)j->truth->ntrajectory;
    j->seen = calloc(n, sizeof *j->seen);
    j->which = calloc(n, sizeof *j->which);
    if (j->seen == NULL || j->which == NULL) {
        return pm_fail(PM_ENOMEM, "evaluate: out of memory");
    }
    // By digests of whole trajectories, before later states are left out.
    int count = 0;
    PM_TRY(pm_seen_choose(j->system, j->truth, a->trajectories, a->json, j->seen, &j->known,
                          j->which, &count));
    if (a->until > 0) {
        const double steps = floor(a->until / j->truth->dt * (1 + ROUNDING));
        if (steps < 1) {
            return pm_fail(PM_EUSAGE, "--until: expected at least one step of %g s, found %g s",
                           j->truth->dt, a->until);
        }
        if (steps < j->truth->ntime - 1) {
            pm_dataset_shorten(j->truth, 1 + (int)steps);
        }
    }
    PM_TRY(roll_out(&j->evaluation, j, count));
    PM_TRY(pm_thermo_make(&j->thermo, j->evaluation));
    if (a->trained != NULL) {
        PM_TRY(pm_options_list(a->trained, j->truth->ntrajectory, j->which, &count));
        PM_TRY(roll_out(&j->trained, j, count));
    }
    return PM_OK;
}

// Writes the predicted trajectories as a dataset.
static pm_status record(const pm_evaluation *e, const char *path, const char *command) {
    pm_dataset *predicted = e->predicted;
    PM_TRY(pm_dataset_note(predicted, "title", "Rollouts of scene %s", e->system->scene->name));
    PM_TRY(pm_dataset_note(predicted, "source", "portmet-train evaluate"));
    PM_TRY(pm_dataset_note(predicted, "command", "%s", command));
    PM_TRY(pm_dataset_note(predicted, "first_trajectory", "%d", e->rollout[0].trajectory));
    PM_TRY(pm_dataset_note(predicted, "digest", "%016llx", (unsigned long long)e->system->digest));
    const char *coordinates = pm_dataset_find_note(e->truth, "coordinates");
    PM_TRY(coordinates == NULL ? PM_OK
                               : pm_dataset_note(predicted, "coordinates", "%s", coordinates));
    // The file has the units of the given one.
    PM_TRY(pm_dataset_restore_units(predicted, e->truth));
    return pm_dataset_save(predicted, path);
}

pm_status pm_command_evaluate(int argc, char **argv, const volatile sig_atomic_t *stop) {
    pm_evaluate_arguments a = {0};
    pm_words given = {0};
    double seconds = 0; // to estimate from
    const pm_option table[] = {
        {"--data", "-d", "FILE...", NULL, &a.data, true,
         .help = "dataset to score against, or tables (see import --help)"},
        {"--trajectories", NULL, "A:B", NULL, &a.trajectories, false,
         .help = "only these trajectories; default: those not used in training"},
        {"--trained", NULL, "A:B", NULL, &a.trained, false,
         .help = "trajectories used in training, to print their errors as well"},
        {"--weights", "-w", "DIR", NULL, &a.weights, false,
         .help = "take the weights files from DIR instead of where the scene says"},
        {"--record", NULL, "FILE", NULL, &a.record, false,
         .help = "write the predicted trajectories as a dataset like the given one",
         .is_output = true, .kind = PM_FILES_HDF5},
        {"--plot", NULL, "DIR", NULL, &a.plot, false,
         .help = "draw errors, error growth, laws and trajectories into DIR (gnuplot); with bands "
                 "after "
                 "--estimate"},
        {"--estimate", NULL, "SECONDS", .positive = &seconds,
         .help =
             "the data are measurements: estimate each start from these first seconds; default: "
             "`estimate` of the reference in the scene"},
        {"--states", NULL, "FILE", NULL, &a.states, false,
         .help = "with --estimate: write the predicted states, from which portmetd can start a run",
         .is_output = true, .kind = PM_FILES_HDF5},
        {"--data-set", NULL, "NAME", NULL, &a.data_set, false,
         .help = "with --estimate: the dataset in FILE, such as z_noise; default: z"},
        {"--truth", NULL, "FILE", NULL, &a.truth, false,
         .help = "with --estimate: states without noise, to print the errors of all variables"},
        {"--until", NULL, "SECONDS", .positive = &a.until,
         .help = "without --estimate: roll out these first seconds of each trajectory alone"},
        {"--json", NULL, NULL, &a.json, NULL, false, .help = "print JSON instead of tables"},
    };
    const pm_options options = {
        .usage = "portmet-train evaluate SCENE --data FILE... [options]",
        .summary =
            "Rolls a scene out from the first state of each trajectory. Prints the relative L2\n"
            "error of each group of variables per trajectory and per snapshot (whiskers of 1.5\n"
            "interquartile ranges, quartiles, median, mean), the errors of the entropy produced,\n"
            "of the power through each port and of the energy and entropy of each subsystem, and\n"
            "how well energy was conserved and entropy kept from falling. The exit code is 10 if\n"
            "a component that keeps a law by construction violates it.",
        .examples =
            "portmet-train evaluate cart/scene.yaml --weights cart/weights --data test_*.csv\n"
            "portmet-train evaluate configs/double_pendulum.yaml --data pendula.h5 --trajectories "
            "40:50",
        .positional_name = "SCENE",
        .positional = &a.scene,
        PM_OPTION_TABLE(table),
        .several = "--data",
        .words = &given,
    };
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    job j = {.stop = stop};
    pm_data_file data = {0};
    pm_status status;
    PM_TRY_DONE(pm_options_read(&options, argc, argv));
    PM_TRY_DONE(pm_data_open(&data, &given, NULL, a.json));
    a.data = data.path;
    PM_TRY_DONE(pm_scene_load(&j.scene, a.scene));
    PM_TRY_DONE(pm_system_load(&j.system, j.scene, a.weights));
    seconds = seconds == 0 ? j.scene->run.reference_estimate : seconds; // as in a run
    if (a.plot != NULL) {
        PM_TRY_DONE(pm_python_check_pictures(seconds > 0 ? "estimate" : "evaluation", a.plot));
    }
    if (seconds > 0) {
        status = pm_evaluate_from_estimate(j.system, &a, seconds, stop);
        goto done;
    }
    PM_TRY_DONE(evaluate(&j, &a));
    if (a.json) {
        pm_evaluation_print_json(j.evaluation, j.trained, &j.thermo, j.known ? j.seen : NULL);
    } else {
        pm_evaluation_print(j.evaluation, j.trained, &j.thermo);
    }
    if (a.record != NULL) {
        PM_TRY_DONE(record(j.evaluation, a.record, command));
    }
    if (a.plot != NULL) {
        PM_TRY_DONE(pm_evaluation_plot(j.evaluation, j.trained, a.plot));
    }
    const pm_rollout *violating = pm_evaluation_violation(j.evaluation);
    status = violating == NULL ? PM_OK : pm_fail(PM_ELAW, "%s", violating->violation);
done:
    pm_thermo_free(&j.thermo);
    pm_evaluation_free(j.trained);
    pm_evaluation_free(j.evaluation);
    pm_dataset_free(j.truth);
    pm_system_free(j.system);
    pm_scene_free(j.scene);
    pm_data_close(&data);
    free(given.word);
    free(j.seen);
    free(j.which);
    return status;
}
