// portmet-train evaluate: scores rollouts of a scene against a dataset.
#include "command/commands.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/progress.h"
#include "command/options.h"
#include "evaluate/evaluate.h"
#include "evaluate/evaluate_plot.h"
#include "evaluate/evaluate_report.h"

typedef struct arguments {
    const char *scene, *data, *weights, *trajectories, *trained, *record, *plot;
    bool json;
} arguments;

static pm_status read_arguments(arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--data", "-d", "FILE", NULL, &a->data, true, "dataset to score against (HDF5)"},
        {"--trajectories", NULL, "A:B", NULL, &a->trajectories, false,
         "only trajectories A up to, not including, B"},
        {"--trained", NULL, "A:B", NULL, &a->trained, false,
         "trajectories that training saw: their errors beside the others"},
        {"--weights", "-w", "DIR", NULL, &a->weights, false,
         "take the weights files from DIR instead of where the scene says"},
        {"--record", NULL, "FILE", NULL, &a->record, false,
         "write the predicted trajectories as a dataset like the given one"},
        {"--plot", NULL, "DIR", NULL, &a->plot, false,
         "draw errors, error growth, laws and the first trajectory into DIR (gnuplot)"},
        {"--json", NULL, NULL, &a->json, NULL, false, "print JSON instead of tables"},
    };
    const pm_options options = {
        .usage = "portmet-train evaluate SCENE --data FILE [options]",
        .summary =
            "Rolls a scene out from the first state of each trajectory and prints the relative L2\n"
            "error of each group of variables, per trajectory and per snapshot: whiskers (1.5\n"
            "interquartile ranges), quartiles, median; and how well both laws were kept. Ends "
            "with\n"
            "exit code 10 if a component that keeps a law by construction violates it.",
        .positional_name = "SCENE",
        .positional = &a->scene,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    return pm_options_read(&options, argc, argv, helped);
}

static void show_progress(void *context, int rollout) {
    pm_progress_update(context, rollout, NULL);
}

static pm_status run(pm_evaluation **evaluation, const char *trajectories, const pm_system *system,
                     const pm_dataset *truth, const volatile sig_atomic_t *stop) {
    int first = 0, end = 0;
    PM_TRY(pm_options_range(trajectories, truth->ntrajectory, &first, &end));
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    pm_progress progress;
    const pm_evaluate_how how = {
        .threads = processors > 0 && processors < 16 ? (int)processors : 16,
        .stop = stop,
        .progress = show_progress,
        .context = &progress,
    };
    pm_progress_init(&progress, "evaluate", end - first);
    const pm_status status = pm_evaluate(evaluation, system, truth, first, end, &how);
    pm_progress_finish(&progress);
    return status;
}

static pm_status record(const pm_evaluation *e, const arguments *a, const char *command) {
    pm_dataset *predicted = e->predicted;
    static const char *const kept[] = {"units", "coordinates"};
    PM_TRY(pm_dataset_note(predicted, "title", "Rollouts of scene %s", e->system->scene->name));
    PM_TRY(pm_dataset_note(predicted, "source", "portmet-train evaluate"));
    PM_TRY(pm_dataset_note(predicted, "command", "%s", command));
    PM_TRY(pm_dataset_note(predicted, "first_trajectory", "%d", e->rollout[0].trajectory));
    PM_TRY(pm_dataset_note(predicted, "digest", "%016llx", (unsigned long long)e->system->digest));
    for (size_t i = 0; i < sizeof kept / sizeof *kept; ++i) {
        const char *text = pm_dataset_find_note(e->truth, kept[i]);
        if (text != NULL) {
            PM_TRY(pm_dataset_note(predicted, kept[i], "%s", text));
        }
    }
    return pm_dataset_save(predicted, a->record);
}

static pm_status deliver(const pm_evaluation *e, const pm_evaluation *trained, const arguments *a,
                         const char *command) {
    if (a->json) {
        pm_evaluation_print_json(e, trained);
    } else {
        pm_evaluation_print(e, trained);
    }
    if (a->record != NULL) {
        PM_TRY(record(e, a, command));
    }
    if (a->plot != NULL) {
        PM_TRY(pm_evaluation_plot(e, trained, a->plot));
    }
    const pm_rollout *violating = pm_evaluation_violation(e);
    return violating == NULL ? PM_OK : pm_fail(PM_ELAW, "%s", violating->violation);
}

pm_status pm_command_evaluate(int argc, char **argv, const volatile sig_atomic_t *stop) {
    arguments a;
    memset(&a, 0, sizeof a);
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_dataset *truth = NULL;
    pm_evaluation *evaluation = NULL, *trained = NULL;
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&scene, a.scene));
    PM_TRY_DONE(pm_system_load(&system, scene, a.weights));
    PM_TRY_DONE(pm_dataset_load(&truth, a.data));
    PM_TRY_DONE(pm_system_check_dataset(system, truth, a.data));
    PM_TRY_DONE(run(&evaluation, a.trajectories, system, truth, stop));
    if (a.trained != NULL) {
        PM_TRY_DONE(run(&trained, a.trained, system, truth, stop));
    }
    PM_TRY_DONE(deliver(evaluation, trained, &a, command));
done:
    pm_evaluation_free(trained);
    pm_evaluation_free(evaluation);
    pm_dataset_free(truth);
    pm_system_free(system);
    pm_scene_free(scene);
    return status;
}
