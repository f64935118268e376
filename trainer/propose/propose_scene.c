// Writes scenes for the form free: a copy with ports of the law exchange, and a scene of
// one subsystem that has the groups of all.
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "propose/propose.h"

pm_status pm_propose_scene(const char *from, const char *path) {
    FILE *in = fopen(from, "r"), *out = in == NULL ? NULL : fopen(path, "w");
    if (out == NULL) {
        const char *which = in == NULL ? from : path;
        const char *why = strerror(errno);
        if (in != NULL) {
            fclose(in);
        }
        return pm_fail(PM_EFILE, "%s: %s", which, why);
    }
    char *line = NULL;
    size_t size = 0;
    fprintf(out, "# %s with ports of the law exchange, for models in the form free.\n", from);
    while (getline(&line, &size, in) > 0) {
        const char *law = strstr(line, "law: bracket");
        if (law != NULL) {
            fprintf(out, "%.*slaw: exchange%s", (int)(law - line), line,
                    law + strlen("law: bracket"));
        } else {
            fputs(line, out);
        }
    }
    free(line);
    const bool failed = ferror(in) != 0 || ferror(out) != 0;
    fclose(in);
    return fclose(out) == 0 && !failed ? PM_OK : pm_fail(PM_EFILE, "%s: cannot be written", path);
}

bool pm_propose_fits_one(const pm_scene *scene) {
    int count = 0;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        count += scene->subsystem[i].layout.ngroup;
    }
    return scene->nboundary_input == 0 && count <= PM_MAX_GROUPS;
}

// Writes one group with its columns, in quotation marks.
static void write_group(FILE *file, const pm_scene_subsystem *subsystem, const pm_group *group) {
    fprintf(file, "      %s_%s: {unit: \"%s\", columns: [", subsystem->name, group->name,
            group->unit);
    for (int c = 0; c < group->size; ++c) {
        fprintf(file, "%s\"%s\"", c > 0 ? ", " : "", subsystem->column[group->first + c]);
    }
    fputs("]}\n", file);
}

pm_status pm_propose_scene_of_one(const pm_scene *scene, const char *path) {
    // A model of the form free has no energy, which some methods need.
    const pm_integrator *own = scene->integrator;
    const bool needs_energy = own->balanced || own->discrete || own->multirate;
    FILE *file = fopen(path, "w");
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    fprintf(file,
            "# %s as one subsystem, for models without structure.\n"
            "scene: %s\n"
            "time: {dt: %.17g, steps: %d, integrator: %s, substeps: %d}\n"
            "subsystems:\n"
            "  all:\n"
            "    weights: weights/all.h5\n"
            "    state:\n",
            scene->path, scene->name, scene->dt, scene->steps, needs_energy ? "rk4" : own->name,
            scene->substeps);
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &scene->subsystem[i];
        for (int g = 0; g < subsystem->layout.ngroup; ++g) {
            write_group(file, subsystem, &subsystem->layout.group[g]);
        }
    }
    const bool failed = ferror(file) != 0;
    return fclose(file) == 0 && !failed ? PM_OK : pm_fail(PM_EFILE, "%s: cannot be written", path);
}
