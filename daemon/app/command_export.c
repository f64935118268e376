// portmetd export: turns a scene into C source or an FMU, for programs that know nothing of
// portmet.
#include <stdio.h>

#include "app/command.h"
#include "app/prepare.h"
#include "export/fmu.h"
#include "export/source.h"

static pm_status export_c(const pm_setup *setup, const pm_run_options *options) {
    const char *folder = options->c_folder, *name = setup->scene->name;
    PM_TRY(pm_export_c(setup, folder));
    if (!options->quiet) {
        printf("wrote %s/%s.h and %s/%s.c\n", folder, name, folder, name);
    }
    return PM_OK;
}

static pm_status export_fmu(const pm_setup *setup, const pm_run_options *options) {
    bool compiled = false;
    PM_TRY(pm_export_fmu(setup, options->output, &compiled));
    if (!options->quiet) {
        printf("wrote %s, %s\n", options->output,
               compiled ? "with sources and a binary for this machine"
                        : "with sources alone: there is no C compiler");
    }
    return PM_OK;
}

static pm_status execute(const pm_run_options *options) {
    pm_setup setup = {0};
    pm_status status;
    if (options->c_folder == NULL && options->output == NULL) {
        return pm_fail(PM_EUSAGE, "export: expected --c DIR, -o FILE.fmu, or both");
    }
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_SERVE));
    if (options->c_folder != NULL) {
        PM_TRY_DONE(export_c(&setup, options));
    }
    if (options->output != NULL) {
        PM_TRY_DONE(export_fmu(&setup, options));
    }
done:
    pm_setup_free(&setup);
    return status;
}

static const pm_command command = {
    .arguments = "SCENE",
    .help =
        "Writes the scene for programs that know nothing of portmet: with --c as a header and a\n"
        "source in C99 that need only libm and allocate nothing, with -o as an FMU (FMI 3.0, "
        "Model\n"
        "Exchange and Co-Simulation). Both step with the bits of `portmetd run --in-process`.\n"
        "Boundary inputs become inputs that hold over a step. The integrator must be an explicit\n"
        "one with fixed substeps.",
    .accepts = PM_OPTION_C | PM_OPTION_OUTPUT | PM_OPTION_WEIGHTS | PM_OPTION_QUIET,
    .execute = execute,
};

pm_status pm_command_export(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
