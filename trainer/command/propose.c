// portmet-train propose: writes a training file for a scene from its units, ports and data.
#include "command/commands.h"

#include <string.h>

#include "base/options.h"
#include "propose/propose.h"

pm_status pm_command_propose(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;                                                  // nothing here takes long
    static const char *const forms[] = {"hard", "soft", "free"}; // in the order of pm_form
    const char *scene = NULL, *data = NULL, *output = NULL, *text = forms[PM_HARD];
    bool helped = false;
    const pm_option table[] = {
        {"--data", "-d", "FILE", NULL, &data, true, "dataset to examine (HDF5)"},
        {"--output", "-o", "FILE", NULL, &output, true, "training file to write (YAML)"},
        {"--form", NULL, "FORM", NULL, &text, false,
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
        .positional = &scene,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, &helped));
    PM_TRY(pm_options_output("--output", output));
    if (helped) {
        return PM_OK;
    }
    for (int form = PM_HARD; form <= PM_FREE; ++form) {
        if (strcmp(text, forms[form]) == 0) {
            return pm_propose_files(scene, data, (pm_form)form, output);
        }
    }
    return pm_fail(PM_EUSAGE, "--form: expected hard, soft or free, found \"%.40s\"", text);
}
