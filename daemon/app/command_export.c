// portmetd export: turns a scene into C source for programs that know nothing of portmet.
#include <stdio.h>

#include "app/command.h"
#include "app/prepare.h"
#include "export/source.h"

static pm_status execute(const pm_run_options *options) {
    pm_setup setup = {0};
    pm_status status;
    if (options->c_folder == NULL) {
        return pm_fail(PM_EUSAGE, "export: expected --c DIR");
    }
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_SERVE));
    PM_TRY_DONE(pm_export_c(&setup, options->c_folder));
    if (!options->quiet) {
        printf("wrote %s/%s.h and %s/%s.c\n", options->c_folder, setup.scene->name,
               options->c_folder, setup.scene->name);
    }
done:
    pm_setup_free(&setup);
    return status;
}

static const pm_command command = {
    .arguments = "SCENE",
    .help =
        "Writes the scene as a header and a source in C99 that need only libm, allocate nothing,\n"
        "and step with the bits of `portmetd run --in-process`. Boundary inputs become inputs "
        "that\n"
        "hold over a step. The integrator must be an explicit one with fixed substeps.",
    .accepts = PM_OPTION_C | PM_OPTION_WEIGHTS | PM_OPTION_QUIET,
    .execute = execute,
};

pm_status pm_command_export(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
