// portmet-train picture: draws bodies of field files at one time.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/options.h"
#include "body/picture.h"
#include "command/commands.h"

#define MOST_FIELDS 16

typedef struct picture_arguments {
    const char *path[MOST_FIELDS + 1]; // NULL after the last
    const char *trajectory, *time, *output;
    bool error;
} picture_arguments;

static pm_status read_arguments(picture_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--output", "-o", "FILE", NULL, &a->output, true, "picture to write (PNG)"},
        {"--trajectory", NULL, "I", NULL, &a->trajectory, false,
         "draw this trajectory, counted from 0 (default: 0)"},
        {"--time", NULL, "T", NULL, &a->time, false,
         "s; draw the state nearest to it (default: the last)"},
        {"--error", NULL, NULL, &a->error, NULL, false,
         "draw the difference of the stresses of two fields in a further panel"},
    };
    const pm_options options = {
        .usage = "portmet-train picture FIELD [FIELD...] -o FILE [options]",
        .summary =
            "Draws the deformed surfaces of bodies, coloured by von Mises stress, with gnuplot.\n"
            "FIELD is a file of nodal fields, such as `truth` writes for bodies on a mesh. Bodies\n"
            "whose files contain a placement are drawn in one scene, others in panels.",
        .positional_name = "FIELD",
        .positional = a->path,
        .most = MOST_FIELDS,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    return pm_options_read(&options, argc, argv, helped);
}

static pm_status read_number(const char *name, const char *text, double *number) {
    char *end;
    *number = strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*number)
               ? PM_OK
               : pm_fail(PM_EUSAGE, "picture: %s \"%s\": expected a number", name, text);
}

static pm_status draw(const picture_arguments *a, const pm_field *const *field, int count) {
    pm_picture picture = {.count = count,
                          .field = field,
                          .title = a->path,
                          .time = field[0]->t[field[0]->ntime - 1],
                          .error = a->error};
    double number = 0;
    if (a->trajectory != NULL) {
        PM_TRY(read_number("--trajectory", a->trajectory, &number));
    }
    if (number != floor(number) || fabs(number) > 1e9) {
        return pm_fail(PM_EUSAGE, "picture: --trajectory \"%s\": expected a whole number",
                       a->trajectory);
    }
    picture.trajectory = (int)number;
    if (a->time != NULL) {
        PM_TRY(read_number("--time", a->time, &picture.time));
    }
    PM_TRY(pm_picture_draw(&picture, a->output));
    printf("wrote %s\n", a->output);
    return PM_OK;
}

pm_status pm_command_picture(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    picture_arguments a = {.path = {NULL}};
    pm_field *field[MOST_FIELDS] = {NULL};
    bool helped = false;
    int count = 0;
    pm_status status;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    for (; a.path[count] != NULL; ++count) {
        PM_TRY_DONE(pm_field_load(&field[count], a.path[count]));
    }
    status = draw(&a, (const pm_field *const *)field, count);
done:
    for (int i = 0; i < MOST_FIELDS; ++i) {
        pm_field_free(field[i]);
    }
    return status;
}
