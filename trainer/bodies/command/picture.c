// portmet-train picture: draws bodies of field files at one time, by the Python package, which
// reads the same options.
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/options.h"
#include "base/path.h"
#include "base/python.h"
#include "bodies/bodies.h"

#define MOST_FIELDS 16

pm_status pm_command_picture(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    const char *field[MOST_FIELDS + 1] = {NULL}; // NULL after the last
    const char *trajectory = NULL, *time = NULL, *output = NULL, *beside = NULL;
    bool error = false;
    const pm_option table[] = {
        {"--output", "-o", "FILE", NULL, &output, true, .help = "picture to write (PNG)",
         .is_output = true},
        {"--beside", NULL, "LIST", NULL, &beside, false,
         .help = "fields of the same bodies, joined by commas, to draw in a scene below, as "
                 "learned below "
                 "true"},
        {"--trajectory", NULL, "I[,J]", NULL, &trajectory, false,
         .help = "draw trajectory I, and J (default: I) of the fields of --beside, counted from 0 "
                 "(default: 0)"},
        {"--time", NULL, "T", NULL, &time, false,
         .help = "s; draw the state nearest to it (default: the last)"},
        {"--error", NULL, NULL, &error, NULL, false,
         .help = "draw the difference of the stresses of two fields, or of those of --beside and "
                 "FIELDs, "
                 "in a further panel"},
    };
    const pm_options options = {
        .usage = "portmet-train picture FIELD [FIELD...] -o FILE [options]",
        .summary =
            "Draws the deformed surfaces of bodies, coloured by von Mises stress, with gnuplot.\n"
            "FIELD is a file of nodal fields, such as `truth` writes for bodies on a mesh. Bodies\n"
            "whose files contain a placement are drawn in one scene, others in panels.",
        .examples = "portmet-train picture true.h5 learned.h5 --time 0.85 -o bodies.png",
        .positional_name = "FIELD",
        .positional = field,
        .most = MOST_FIELDS,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    char path[PATH_MAX];
    for (const char *at = beside; at != NULL && *at != '\0';) {
        const int length = (int)strcspn(at, ",");
        snprintf(path, sizeof path, "%.*s", length, at);
        pm_files_note_input(path);
        at += length + (at[length] == ',');
    }
    PM_TRY(pm_files_check_output(output, PM_FILES_PICTURE));
    snprintf(path, sizeof path, "%.*s", (int)pm_path_stem(output), output);
    PM_TRY(pm_python_check_pictures("bodies", path));
    const char **argument = calloc((size_t)argc + 1, sizeof *argument);
    PM_TRY(pm_allocated(argument, "a picture"));
    argument[0] = "bodies";
    memcpy(argument + 1, argv + 1, (size_t)(argc - 1) * sizeof *argument);
    const pm_status status = pm_python_run(&pm_python_pictures, argument, false);
    free(argument);
    PM_TRY(status);
    printf("wrote %s\n", output);
    return PM_OK;
}
