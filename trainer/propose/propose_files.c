// Loads the scene and the dataset of a proposal, and makes their paths absolute.
#include "propose/propose_files.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/path.h"
#include "base/unit.h"
#include "propose/propose.h"
#include "store/yaml.h"

// Paths in a training file are relative to its folder. Absolute paths are valid everywhere. The
// caller frees the result.
static char *absolute(const char *path) {
    char *whole = realpath(path, NULL);
    return whole != NULL ? whole : strdup(path);
}

// Prints a line for each group whose unit is not known. Such a group gets no role.
static void name_unknown_units(const pm_scene *scene) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &scene->subsystem[i];
        for (int g = 0; g < subsystem->layout.ngroup; ++g) {
            const pm_group *group = &subsystem->layout.group[g];
            if (!pm_unit_parse(group->unit).known) {
                printf("%s.%s: the unit \"%s\" is not known, so that the proposal cannot tell what "
                       "the "
                       "group is. SI units with prefixes are known, such as kg m/s, mm or kJ/K.\n",
                       subsystem->name, group->name, group->unit);
            }
        }
    }
}

static pm_status write_proposal(const char *scene_path, const char *data, pm_form form,
                                const char *output) {
    pm_scene *scene = NULL;
    pm_dataset *dataset = NULL;
    char *scene_name = NULL, *data_name = NULL;
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&scene, scene_path));
    PM_TRY_DONE(pm_dataset_load(&dataset, data));
    scene_name = absolute(scene_path);
    data_name = absolute(data);
    if (scene_name == NULL || data_name == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a path");
        goto done;
    }
    const pm_proposal proposal = {.scene = scene,
                                  .dataset = dataset,
                                  .scene_path = scene_name,
                                  .data_path = data_name,
                                  .form = form};
    PM_TRY_DONE(pm_propose(&proposal, output));
    name_unknown_units(scene);
    printf("wrote %s\n", output);
done:
    free(scene_name);
    free(data_name);
    pm_dataset_free(dataset);
    pm_scene_free(scene);
    return status;
}

// Writes the scene of a black box, which has all groups in one subsystem where that is possible.
// Otherwise the scene keeps its subsystems, and its ports have the law exchange.
static pm_status write_other_scene(const char *from, const char *path) {
    pm_scene *scene = NULL;
    PM_TRY(pm_scene_load(&scene, from));
    const pm_status status = pm_propose_fits_one(scene) ? pm_propose_scene_of_one(scene, path)
                                                        : pm_propose_scene(from, path);
    pm_scene_free(scene);
    return status;
}

pm_status pm_propose_files(const char *scene, const char *data, pm_form form, const char *output) {
    if (form != PM_FREE) {
        return write_proposal(scene, data, form, output);
    }
    char exchange[PATH_MAX];
    const int length =
        snprintf(exchange, sizeof exchange, "%.*s_scene.yaml", (int)pm_path_stem(output), output);
    if (length >= (int)sizeof exchange) {
        return pm_fail(PM_EUSAGE, "%s: the path is too long", output);
    }
    PM_TRY(write_other_scene(scene, exchange));
    printf("wrote %s\n", exchange);
    return write_proposal(exchange, data, form, output);
}

bool pm_propose_is_scene(const char *path) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    if (pm_yaml_open(&document, path, &root) != PM_OK) {
        return false; // the reader of the file reports the error
    }
    const bool scene = pm_yaml_exists(pm_yaml_get(root, "time"));
    pm_yaml_close(document);
    return scene;
}
