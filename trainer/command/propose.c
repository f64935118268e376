// portmet-train propose: writes a training file for a scene from its units, ports and data.
#include "command/commands.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "base/path.h"
#include "command/tables.h"
#include "propose/logger.h"
#include "propose/propose.h"

pm_status pm_command_budget(const char *text, double *seconds) {
    char *end = NULL;
    const double value = text == NULL ? *seconds : strtod(text, &end);
    if (end != NULL && *end == 's') {
        ++end;
    }
    if (text != NULL && (end == text || *end != '\0' || !(value >= 0 && isfinite(value)))) {
        return pm_fail(PM_EUSAGE, "--budget: expected a time in s, such as 60, found \"%.40s\"",
                       text);
    }
    *seconds = value;
    return PM_OK;
}

pm_status pm_command_propose(int argc, char **argv, const volatile sig_atomic_t *stop) {
    static const char *const forms[] = {"hard", "soft", "free"}; // in the order of pm_form
    const char *scene = NULL, *first = NULL, *output = NULL, *text = forms[PM_HARD];
    const char *inputs = NULL, *hidden = NULL, *first_part = NULL, *first_port = NULL;
    pm_words part = {0}, port = {0};
    int64_t number = 1;
    const char *budget = NULL;
    pm_proposal how = {.budget = PM_PROPOSAL_BUDGET, .loud = true, .stop = stop};
    pm_words given = {0};
    const pm_option table[] = {
        {"--data", "-d", "FILE...", NULL, &first, true,
         .help = "dataset to examine, or tables (see import --help)"},
        {"--output", "-o", "FILE", NULL, &output, true,
         .help = "training file to write (YAML); without SCENE a folder"},
        {"--form", NULL, "FORM", NULL, &text, false,
         .help = "hard (both laws hold; the default), soft, or free (a black box)"},
        {"--inputs", NULL, "A,B", NULL, &inputs, false,
         .help = "without SCENE: the columns that are inputs; default: staircases"},
        {"--part", NULL, "NAME=A,B", NULL, &first_part, false,
         .help =
             "without SCENE: a subsystem and its columns; may be repeated; default: one subsystem"},
        {"--port", NULL, "PART,PART", NULL, &first_port, false,
         .help = "without SCENE: parts that are joined; default: those that move each other"},
        {"--seed", NULL, "N", .count = &number, .least = 1, .most = INT32_MAX,
         .help = "without SCENE: of the training file; default: 1"},
        {"--hidden", NULL, "N", NULL, &hidden, false,
         .help = "without SCENE: how many variables nobody measures; default: short fits tell"},
        {"--budget", NULL, "SECONDS", NULL, &budget, false,
         .help =
             "CPU time for trials of hypotheses; 0: none is tried (default 60, without SCENE 90)"},
    };
    const struct pm_several others[] = {{"--part", &part}, {"--port", &port}, {NULL, NULL}};
    const pm_options options = {
        .usage = "portmet-train propose [SCENE] --data FILE... -o TRAINING|DIR [options]",
        .summary =
            "Writes a training file for the subsystems and ports of SCENE that need weights, with\n"
            "comments that give reasons: units (two variables whose product is J s are conjugate,\n"
            "J/K is an entropy), ports, and statistics of the data (which rates follow which\n"
            "variables, what is conserved, how fast rates change). Where these may be wrong, "
            "other\n"
            "hypotheses are tried by short fits, and the comment at the head of the file says "
            "what\n"
            "was tried and how far each came. Edit the file where you know better. The weights of\n"
            "the longest trial lie beside it (.start), and a fit starts with them.\n"
            "For the form free a scene with a single subsystem is written beside it. Tables are\n"
            "turned into a dataset beside it, whose name ends in _data.h5.\n\n"
            "Without SCENE the columns are what sensors show: velocities, temperatures, currents,\n"
            "and inputs. DIR/scene.yaml, DIR/training.yaml and DIR/data.h5 are written. The scene\n"
            "has the name of DIR.",
        .examples = "portmet-train propose --data run_*.csv --inputs F -o cart\n"
                    "portmet-train propose scene.yaml --data runs.h5 -o training.yaml",
        .positional_name = "SCENE",
        .positional = &scene,
        .least = -1,
        .most = 1,
        PM_OPTION_TABLE(table),
        .several = "--data",
        .words = &given,
        .others = others,
    };
    char keep[PATH_MAX];
    pm_data_file data = {0};
    int form = PM_HARD;
    pm_status status;
    PM_TRY_DONE(pm_options_read(&options, argc, argv));
    PM_TRY_DONE(pm_command_budget(budget, &how.budget));
    if (scene == NULL) {
        const pm_logger_hints hints = {.seed = (int)number,
                                       .budget = budget == NULL ? PM_LOGGER_BUDGET : how.budget,
                                       .stop = stop,
                                       .inputs = inputs,
                                       .npart = part.count,
                                       .part = part.word,
                                       .nport = port.count,
                                       .port = port.word,
                                       .hidden =
                                           hidden == NULL ? -1 : (int)strtol(hidden, NULL, 10)};
        PM_TRY_DONE(pm_options_folder(output));
        snprintf(keep, sizeof keep, "%s/data.h5", output);
        PM_TRY_DONE(pm_data_open(&data, &given, keep, false));
        status = pm_propose_logger(data.path, &hints, output);
        goto done;
    }
    PM_TRY_DONE(pm_options_output("--output", output));
    while (form <= PM_FREE && strcmp(text, forms[form]) != 0) {
        ++form;
    }
    PM_TRY_DONE(
        form <= PM_FREE
            ? PM_OK
            : pm_fail(PM_EUSAGE, "--form: expected hard, soft or free, found \"%.40s\"", text));
    snprintf(keep, sizeof keep, "%.*s_data.h5", (int)pm_path_stem(output), output);
    PM_TRY_DONE(pm_data_open(&data, &given, keep, false));
    how.form = (pm_form)form;
    status = pm_propose_files(scene, data.path, &how, output);
done:
    pm_data_close(&data);
    free(given.word);
    free(part.word);
    free(port.word);
    return status;
}
