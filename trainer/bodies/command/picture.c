// portmet-train picture: draws bodies of field files at one time.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "bodies/bodies.h"
#include "bodies/solid/picture.h"

#define MOST_FIELDS 16

typedef struct picture_arguments {
    const char *path[MOST_FIELDS + 1]; // NULL after the last
    const char *trajectory, *time, *output, *beside;
    bool error;
} picture_arguments;

pm_status pm_command_picture(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    picture_arguments a = {.path = {NULL}};
    bool helped = false;
    const pm_option table[] = {
        {"--output", "-o", "FILE", NULL, &a.output, true, "picture to write (PNG)"},
        {"--beside", NULL, "LIST", NULL, &a.beside, false,
         "fields of the same bodies, joined by commas, to draw in a scene below, as learned below "
         "true"},
        {"--trajectory", NULL, "I[,J]", NULL, &a.trajectory, false,
         "draw trajectory I, and J (default: I) of the fields of --beside, counted from 0 "
         "(default: 0)"},
        {"--time", NULL, "T", NULL, &a.time, false,
         "s; draw the state nearest to it (default: the last)"},
        {"--error", NULL, NULL, &a.error, NULL, false,
         "draw the difference of the stresses of two fields, or of those of --beside and FIELDs, "
         "in a further panel"},
    };
    const pm_options options = {
        .usage = "portmet-train picture FIELD [FIELD...] -o FILE [options]",
        .summary =
            "Draws the deformed surfaces of bodies, coloured by von Mises stress, with gnuplot.\n"
            "FIELD is a file of nodal fields, such as `truth` writes for bodies on a mesh. Bodies\n"
            "whose files contain a placement are drawn in one scene, others in panels.",
        .positional_name = "FIELD",
        .positional = a.path,
        .most = MOST_FIELDS,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, &helped));
    PM_TRY(pm_options_output("--output", a.output));
    if (helped) {
        return PM_OK;
    }
    // The fields of --beside come last.
    const char *path[2 * MOST_FIELDS];
    pm_field *field[2 * MOST_FIELDS] = {NULL};
    int trajectory[2 * MOST_FIELDS], count = 0, nbeside = 0;
    pm_arena arena = {0};
    pm_status status;
    for (; a.path[count] != NULL; ++count) {
        path[count] = a.path[count];
    }
    char *at = a.beside == NULL ? NULL : pm_arena_strdup(&arena, a.beside);
    PM_TRY_DONE(pm_arena_status(&arena, "a picture"));
    for (char *comma = at; at != NULL; at = comma == NULL ? NULL : comma + 1) {
        comma = strchr(at, ',');
        if (comma != NULL) {
            *comma = 0;
        }
        if (nbeside == MOST_FIELDS) {
            status =
                pm_fail(PM_EUSAGE, "picture: --beside: expected at most %d fields", MOST_FIELDS);
            goto done;
        }
        ++nbeside;
        path[count++] = at;
    }
    // I[,J] are the trajectories of all fields.
    int number[2] = {0, 0}, read = 0, found = 1;
    if (a.trajectory != NULL) {
        found = sscanf(a.trajectory, "%9d%n,%9d%n", &number[0], &read, &number[1], &read);
    }
    if (found < 1 || (a.trajectory != NULL && a.trajectory[read] != 0) ||
        (found == 2 && nbeside == 0)) {
        status = pm_fail(PM_EUSAGE, "picture: --trajectory \"%s\": expected a whole number%s",
                         a.trajectory, nbeside == 0 ? "" : ", or two joined by a comma");
        goto done;
    }
    for (int i = 0; i < count; ++i) {
        trajectory[i] = number[found == 2 && i >= count - nbeside];
        PM_TRY_DONE(pm_field_load(&field[i], path[i]));
    }
    pm_picture picture = {.count = count,
                          .nbeside = nbeside,
                          .field = (const pm_field *const *)field,
                          .title = path,
                          .trajectory = trajectory,
                          .time = field[0]->t[field[0]->ntime - 1],
                          .error = a.error};
    if (a.time != NULL) {
        char *end;
        picture.time = strtod(a.time, &end);
        if (end == a.time || *end != '\0' || !isfinite(picture.time)) {
            status = pm_fail(PM_EUSAGE, "picture: --time \"%s\": expected a number", a.time);
            goto done;
        }
    }
    PM_TRY_DONE(pm_picture_draw(&picture, a.output));
    printf("wrote %s\n", a.output);
done:
    for (int i = 0; i < count; ++i) {
        pm_field_free(field[i]);
    }
    pm_arena_free(&arena);
    return status;
}
