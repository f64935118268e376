// Sections of a scene file are found by their lines: a section begins with its key in the first
// column, and goes on until the next line that begins with a letter there. Comments before the next
// key belong to it.
#include "study/scene_text.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "scene/system.h"

// The first line of a scene that is written: a study replaces no file of another kind, nor a scene
// that somebody has written by hand.
#define WRITTEN "# Written by portmetd"

pm_status pm_scene_text_read(const char *path, char **text) {
    size_t size = 0;
    FILE *file = fopen(path, "r");
    *text = NULL;
    const bool read = file != NULL && getdelim(text, &size, '\0', file) > 0;
    const int error = errno;
    if (file != NULL) {
        fclose(file);
    }
    if (!read) {
        free(*text);
        *text = NULL;
        return pm_fail(PM_EFILE, "%s: %s", path, file == NULL ? strerror(error) : "is empty");
    }
    return PM_OK;
}

static char *next_line(char *at) {
    at += strcspn(at, "\n");
    return *at == '\n' ? at + 1 : at;
}

pm_status pm_scene_text_put(char **text, const char *key, const char *value) {
    const size_t length = strlen(key);
    char *first = *text, *made = NULL;
    while (*first != '\0' && (strncmp(first, key, length) != 0 || first[length] != ':')) {
        first = next_line(first);
    }
    char *end = *first == '\0' ? first : next_line(first);
    for (char *line = end; line != first && *line != '\0' && !isalpha((unsigned char)*line);) {
        const bool belongs = *line == ' ' || *line == '}' || *line == ']' || *line == '-';
        line = next_line(line);
        end = belongs ? line : end;
    }
    const bool ends = first == *text || first[-1] == '\n';
    const int size = value == NULL ? asprintf(&made, "%.*s%s", (int)(first - *text), *text, end)
                                   : asprintf(&made, "%.*s%s%s: %s\n%s", (int)(first - *text),
                                              *text, ends ? "" : "\n", key, value, end);
    if (size < 0) {
        return pm_fail(PM_ENOMEM, "out of memory for a scene");
    }
    free(*text);
    *text = made;
    return PM_OK;
}

pm_status pm_scene_text_put_time(char **text, const pm_stepping *s) {
    char value[256], dt[32], tolerance[64] = "";
    if (s->tolerance != 0) {
        snprintf(tolerance, sizeof tolerance, ", tolerance: %.12g", s->tolerance);
    }
    snprintf(dt, sizeof dt, "%.15g", s->dt);
    if (strtod(dt, NULL) != s->dt) {
        snprintf(dt, sizeof dt, "%.17g", s->dt);
    }
    snprintf(value, sizeof value, "{dt: %s, steps: %d, integrator: %s, substeps: %d%s}", dt,
             s->steps, s->integrator->name, s->substeps, tolerance);
    return pm_scene_text_put(text, "time", value);
}

// Writes the key `name` of a group and its `size` numbers.
static void print_list(FILE *file, const char *name, const double *value, int size) {
    for (int i = 0; i < size; ++i) {
        fprintf(file, "%s%.17g", i > 0 ? ", " : name, value[i]);
    }
    fputs("]", file);
}

pm_status pm_scene_text_put_mean_inputs(char **text, const pm_boundary_input *inputs) {
    const pm_physics *physics = &inputs->scene->physics;
    const long end = inputs->end;
    char *section = NULL;
    size_t size;
    if (inputs->n == 0 || end == LONG_MAX) {
        return PM_OK;
    }
    double *mean = calloc(3 * (size_t)inputs->n, sizeof *mean), *value = mean + inputs->n;
    double *first = value + inputs->n;
    FILE *file = mean == NULL ? NULL : open_memstream(&section, &size);
    for (long step = 0; step < end && file != NULL; ++step) {
        pm_boundary_input_at(inputs, step, 0, value);
        for (int i = 0; i < inputs->n; ++i) { // a constant stays as it is
            first[i] = step == 0 ? value[i] : first[i];
            mean[i] += (value[i] - first[i]) / (double)end;
        }
    }
    for (int i = 0; i < inputs->n && file != NULL; ++i) {
        mean[i] += first[i];
    }
    if (file != NULL) { // as a mapping in one line
        for (int i = 0; i < physics->nboundary_input; ++i) {
            const pm_scene_boundary_input *input = &physics->boundary_input[i];
            const pm_layout *layout = &input->layout;
            const double *state = mean + input->first, *dE = state + layout->nz,
                         *dS = dE + layout->nz;
            fprintf(file, "%s%s: {", i > 0 ? ", " : "{", input->name);
            for (int k = 0; k < layout->ngroup; ++k) {
                const pm_group *g = &layout->group[k];
                fprintf(file, "%s%s: {unit: \"%s\"", k > 0 ? ", " : "", g->name, g->unit);
                print_list(file, ", value: [", state + g->first, g->size);
                print_list(file, ", dE: [", dE + g->first, g->size);
                if (input->entropy) {
                    print_list(file, ", dS: [", dS + g->first, g->size);
                }
                fputs("}", file);
            }
            fputs("}", file);
        }
        fputs("}", file);
    }
    const bool made = file != NULL && fclose(file) == 0;
    const pm_status status = made ? pm_scene_text_put(text, "boundary_inputs", section)
                                  : pm_fail(PM_ENOMEM, "out of memory for a scene");
    free(section);
    free(mean);
    return status;
}

pm_status pm_scene_text_check(const char *text, const char *path, const char *weights) {
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_status status;
    if (path == NULL) {
        return PM_OK;
    }
    PM_TRY_DONE(pm_files_check_output(path, WRITTEN));
    PM_TRY_DONE(pm_scene_parse(&scene, text, path));
    status = pm_system_load(&system, scene, weights);
    if (status != PM_OK) {
        status = pm_fail(status, "%s: a scene in another folder does not find its files: %.300s",
                         path, pm_error());
    }
done:
    pm_system_free(system);
    pm_scene_free(scene);
    return status;
}

pm_status pm_scene_text_write(const char *text, const char *path, const char *weights) {
    FILE *file = NULL;
    PM_TRY(pm_scene_text_check(text, path, weights));
    PM_TRY(pm_files_create(&file, path, WRITTEN));
    const bool again = strncmp(text, WRITTEN, strlen(WRITTEN)) == 0;
    const bool written = fprintf(file, "%s%s", again ? "" : WRITTEN ".\n", text) >= 0;
    return fclose(file) == 0 && written ? PM_OK
                                        : pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
}
