// portmetd export: turns a scene into C source or an FMU, for programs that know nothing of
// portmet.
#include <stdio.h>
#include <string.h>

#include "app/command.h"
#include "app/prepare.h"
#include "export/fmu.h"
#include "export/source.h"

static pm_status execute(const pm_run_options *options) {
    const char *folder = options->c_folder, *output = options->output;
    pm_setup setup = {0};
    pm_status status;
    const char *fmi = options->fmi == NULL ? "3" : options->fmi;
    if (strcmp(fmi, "2") != 0 && strcmp(fmi, "3") != 0) {
        return pm_fail(PM_EUSAGE, "--fmi: %s: expected 2 or 3", fmi);
    }
    if (folder == NULL && output == NULL) {
        return pm_fail(PM_EUSAGE, "export: expected --c DIR, -o FILE.fmu, or both");
    }
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_SERVE));
    if (folder != NULL) {
        const char *name = setup.scene->name;
        PM_TRY_DONE(pm_export_c(&setup, folder));
        if (!options->quiet) {
            printf("wrote %s/%s.h and %s/%s.c\n", folder, name, folder, name);
        }
    }
    if (output != NULL) {
        bool compiled = false;
        PM_TRY_DONE(pm_export_fmu(&setup, fmi[0] - '0', options->author, output, &compiled));
        if (!options->quiet) {
            printf("wrote %s, %s\n", output,
                   compiled ? "with sources and a binary for this machine"
                            : "with sources alone: there is no C compiler");
        }
    }
done:
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_export = {
    .name = "export",
    .summary = "write a scene as C source or as an FMU",
    .arguments = "SCENE",
    .help =
        "Writes the scene for programs that know nothing of portmet: with --c as a header and a\n"
        "source in C99 that need only libm and allocate nothing, with -o as an FMU for Model\n"
        "Exchange and Co-Simulation (FMI 3.0, or 2.0 with --fmi 2). Both step with the bits of\n"
        "`portmetd run --in-process`. Boundary inputs become inputs that hold over a step. The\n"
        "integrator must be an explicit one with fixed substeps.",
    .examples = "portmetd export configs/analytic_double_pendulum.yaml --c pendulum\n"
                "portmetd export configs/analytic_double_pendulum.yaml -o pendulum.fmu",
    .accepts = "c output weights quiet",
    .execute = execute,
};
