// portmet-train propose: writes a training file for a scene from its units, ports and data.
#include "command/commands.h"

#include <string.h>

#include "base/options.h"
#include "propose/propose_files.h"

typedef struct propose_arguments {
    const char *scene, *data, *output, *form;
} propose_arguments;

static pm_status read_arguments(propose_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--data", "-d", "FILE", NULL, &a->data, true, "dataset to examine (HDF5)"},
        {"--output", "-o", "FILE", NULL, &a->output, true, "training file to write (YAML)"},
        {"--form", NULL, "FORM", NULL, &a->form, false,
         "hard (both laws hold; the default), soft, or free (a black box)"},
    };
    const pm_options options = {
        .usage = "portmet-train propose SCENE --data FILE -o TRAINING [--form FORM]",
        .summary =
            "Writes a training file for the subsystems and ports of SCENE that need weights, with\n"
            "comments that give reasons: units (two variables whose product is J s are conjugate,\n"
            "J/K is an entropy), ports, and statistics of the data (which rates follow which\n"
            "variables, what is conserved, how fast rates change). Edit it where you know better.\n"
            "For the form free a scene with a single subsystem is written beside it.",
        .positional_name = "SCENE",
        .positional = &a->scene,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, helped));
    return pm_options_output("--output", a->output);
}

static pm_status read_form(const char *text, pm_form *form) {
    static const char *const names[] = {"hard", "soft", "free"};
    for (int i = 0; i < 3; ++i) {
        if (text == NULL || strcmp(text, names[i]) == 0) {
            *form = text == NULL ? PM_HARD : (pm_form)i;
            return PM_OK;
        }
    }
    return pm_fail(PM_EUSAGE, "--form: expected hard, soft or free, found \"%.40s\"", text);
}

pm_status pm_command_propose(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop; // nothing here takes long
    propose_arguments a;
    memset(&a, 0, sizeof a);
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    pm_form form = PM_HARD;
    PM_TRY(read_form(a.form, &form));
    return pm_propose_files(a.scene, a.data, form, a.output);
}
