// From the columns of a logger to a scene and a training file.
#include "propose/logger.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>

#include "propose/logger_draft.h"

// Prints what was found, one line for each column.
static void describe(const pm_logger_view *v) {
    static const char *const kinds[] = {"a position", "a co-energy", "a temperature", "a level",
                                        "an input"};
    static const char *const effects[] = {"drives", "moves, with a learned factor,", "heats",
                                          "heats, with a learned factor,", "is a bath of"};
    for (int c = 0; c < v->ncolumn; ++c) {
        const pm_logger_column *column = &v->column[c];
        printf("%s [%s]: %s", column->name, column->unit, kinds[column->kind]);
        if (column->kind == PM_LOGGER_POSITION) {
            printf(", whose rate is %s%s", v->column[column->mate].name,
                   v->column[column->mate].source == NULL ? ", which nobody measures" : "");
        }
        if (column->noise > 0) {
            const double percent = 100;
            printf("; noise %.2g %% of its deviation", percent * column->noise / column->deviation);
        }
        for (int a = 0; a < v->naction; ++a) {
            if (v->action[a].input == c) {
                printf("; %s %s", effects[v->action[a].effect],
                       v->column[v->action[a].target].name);
            }
        }
        if (column->free_scale) {
            printf("; nothing shows its scale, which is 1");
        }
        printf("%s\n", column->held ? "; held between samples" : "");
    }
}

pm_status pm_propose_logger(const char *data, const pm_logger_hints *hints, const char *folder) {
    pm_logger_draft draft = {.seed = hints->seed};
    pm_dataset *dataset = NULL;
    char scene[PATH_MAX], training[PATH_MAX];
    char *data_path = realpath(data, NULL), *scene_path = NULL;
    bool looked = false;
    pm_status status;
    PM_TRY_DONE(data_path == NULL ? pm_fail(PM_EFILE, "%s: cannot be read", data) : PM_OK);
    if (snprintf(scene, sizeof scene, "%s/scene.yaml", folder) >= (int)sizeof scene ||
        snprintf(training, sizeof training, "%s/training.yaml", folder) >= (int)sizeof training) {
        status = pm_fail(PM_EUSAGE, "%s: the path is too long", folder);
        goto done;
    }
    PM_TRY_DONE(pm_dataset_load_measured(&dataset, data, "z"));
    PM_TRY_DONE(pm_logger_look(&draft.view, dataset, hints));
    looked = true;
    describe(&draft.view);
    draft.data_path = data_path;
    PM_TRY_DONE(pm_logger_write_scene(&draft, scene));
    scene_path = realpath(scene, NULL);
    PM_TRY_DONE(scene_path == NULL ? pm_fail(PM_EFILE, "%s: cannot be read", scene) : PM_OK);
    draft.scene_path = scene_path;
    const int chosen[PM_LOGGER_NCHOICE] = {0};
    PM_TRY_DONE(pm_logger_write_training(&draft, chosen, "", training));
    printf("wrote %s\nwrote %s\n", scene, training);
done:
    if (looked) {
        pm_logger_view_free(&draft.view);
    }
    pm_dataset_free(dataset);
    free(data_path);
    free(scene_path);
    return status;
}
