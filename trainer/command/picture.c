// portmet-train picture: draws bodies of field files at one time.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "body/picture.h"
#include "command/commands.h"

#define MOST_FIELDS 16

typedef struct picture_arguments {
    const char *path[MOST_FIELDS + 1]; // NULL after the last
    const char *trajectory, *time, *output, *beside;
    bool error;
} picture_arguments;

// A list of the fields of the picture. Those of --beside come last.
typedef struct field_list {
    int count, nbeside;
    const char *path[2 * MOST_FIELDS];
    pm_field *field[2 * MOST_FIELDS];
    int trajectory[2 * MOST_FIELDS];
    char *beside; // the value of --beside, cut at its commas
} field_list;

static pm_status read_arguments(picture_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--output", "-o", "FILE", NULL, &a->output, true, "picture to write (PNG)"},
        {"--beside", NULL, "LIST", NULL, &a->beside, false,
         "fields of the same bodies, joined by commas, to draw in a scene below, as learned below "
         "true"},
        {"--trajectory", NULL, "I[,J]", NULL, &a->trajectory, false,
         "draw trajectory I, and J (default: I) of the fields of --beside, counted from 0 "
         "(default: 0)"},
        {"--time", NULL, "T", NULL, &a->time, false,
         "s; draw the state nearest to it (default: the last)"},
        {"--error", NULL, NULL, &a->error, NULL, false,
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
        .positional = a->path,
        .most = MOST_FIELDS,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, helped));
    return pm_options_output("--output", a->output);
}

static pm_status read_number(const char *name, const char *text, double *number) {
    char *end;
    *number = strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*number)
               ? PM_OK
               : pm_fail(PM_EUSAGE, "picture: %s \"%s\": expected a number", name, text);
}

// Reads I[,J] into the trajectories of all fields.
static pm_status read_trajectories(const char *text, field_list *j) {
    int number[2] = {0, 0}, read = 0, count = 1;
    if (text != NULL) {
        count = sscanf(text, "%9d%n,%9d%n", &number[0], &read, &number[1], &read);
    }
    if (count < 1 || (text != NULL && text[read] != 0) || (count == 2 && j->nbeside == 0)) {
        return pm_fail(PM_EUSAGE, "picture: --trajectory \"%s\": expected a whole number%s", text,
                       j->nbeside == 0 ? "" : ", or two joined by a comma");
    }
    for (int i = 0; i < j->count; ++i) {
        j->trajectory[i] = number[count == 2 && i >= j->count - j->nbeside];
    }
    return PM_OK;
}

// Lists the paths of all fields.
static pm_status list_fields(const picture_arguments *a, field_list *j) {
    for (; a->path[j->count] != NULL; ++j->count) {
        j->path[j->count] = a->path[j->count];
    }
    j->beside = a->beside == NULL ? NULL : strdup(a->beside);
    if (a->beside != NULL && j->beside == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a picture");
    }
    for (char *at = j->beside, *comma = at; at != NULL; at = comma == NULL ? NULL : comma + 1) {
        comma = strchr(at, ',');
        if (comma != NULL) {
            *comma = 0;
        }
        if (j->nbeside == MOST_FIELDS) {
            return pm_fail(PM_EUSAGE, "picture: --beside: expected at most %d fields", MOST_FIELDS);
        }
        ++j->nbeside;
        j->path[j->count++] = at;
    }
    return PM_OK;
}

static pm_status draw(const picture_arguments *a, field_list *j) {
    PM_TRY(list_fields(a, j));
    PM_TRY(read_trajectories(a->trajectory, j));
    for (int i = 0; i < j->count; ++i) {
        PM_TRY(pm_field_load(&j->field[i], j->path[i]));
    }
    pm_picture picture = {.count = j->count,
                          .nbeside = j->nbeside,
                          .field = (const pm_field *const *)j->field,
                          .title = j->path,
                          .trajectory = j->trajectory,
                          .time = j->field[0]->t[j->field[0]->ntime - 1],
                          .error = a->error};
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
    field_list j = {.count = 0};
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    const pm_status status = draw(&a, &j);
    for (int i = 0; i < j.count; ++i) {
        pm_field_free(j.field[i]);
    }
    free(j.beside);
    return status;
}
