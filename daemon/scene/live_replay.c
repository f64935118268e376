// The sample after a step holds the values that held during it; that of step 0 holds none.
#include "scene/live_replay.h"

#include <stdio.h>
#include <string.h>

#include "store/hdf5_io.h"

// Checks that the first `count` samples of a recording are those of the steps 0, 1, 2, ...
static pm_status check_steps(const pm_hdf5 *file, const char *path, const pm_scene *scene,
                             int count, double *column) {
    PM_TRY(pm_hdf5_read(file, "/time", 1, &count, column));
    for (int i = 0; i < count; ++i) {
        if (column[i] != pm_scene_time(scene, i)) {
            return pm_fail(PM_EDATA,
                           "%s: step %d is missing: only a recording of every step can be "
                           "replayed",
                           path, i);
        }
    }
    return PM_OK;
}

static pm_status read_input(const pm_hdf5 *file, const pm_scene *scene,
                            const pm_scene_live_input *input, int count, double *column,
                            double *value) {
    for (int i = 0; i < input->count; ++i) {
        char name[128];
        snprintf(name, sizeof name, "/live/%s", input->name[i]);
        PM_TRY(pm_hdf5_read(file, name, 1, &count, column));
        for (int k = 1; k < count; ++k) {
            value[(ptrdiff_t)(k - 1) * scene->network.nlive + input->first + i] = column[k];
        }
    }
    return PM_OK;
}

static pm_status read_all(const pm_hdf5 *file, const char *path, const pm_scene *scene,
                          pm_arena *arena, double **value, int64_t *steps) {
    int count;
    uint64_t certain;
    const char *recorded;
    PM_TRY(pm_hdf5_read_text(file, "/", "scene", arena, &recorded));
    if (strcmp(recorded, scene->name) != 0) {
        return pm_fail(PM_EDATA, "%s: a recording of scene %.64s, expected one of %s", path,
                       recorded, scene->name);
    }
    PM_TRY(pm_hdf5_shape(file, "/time", 1, &count));
    PM_TRY(pm_hdf5_read_integer(file, "/", "committed", &certain));
    double *column = pm_arena_array(arena, (size_t)count, sizeof *column);
    *value = pm_arena_array(arena, (size_t)count * (size_t)scene->network.nlive, sizeof **value);
    if (column == NULL || *value == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", path);
    }
    PM_TRY(check_steps(file, path, scene, count, column));
    for (int i = 0; i < scene->network.nlive_input; ++i) {
        PM_TRY(read_input(file, scene, &scene->network.live_input[i], count, column, *value));
    }
    *steps = (certain < (uint64_t)count ? (int64_t)certain : count) - 1;
    return PM_OK;
}

static pm_status load(const char *path, const pm_scene *scene, pm_arena *arena, double **value,
                      int64_t *steps) {
    pm_hdf5 *file = NULL;
    PM_TRY(pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA));
    const pm_status status = read_all(file, path, scene, arena, value, steps);
    pm_hdf5_close(file);
    return status;
}

typedef struct protected_load {
    const char *path;
    const pm_scene *scene;
} protected_load;

static void try_load(const void *context) {
    const protected_load *what = context;
    pm_arena arena = {0};
    double *value;
    int64_t steps;
    (void)load(what->path, what->scene, &arena, &value, &steps);
    pm_arena_free(&arena);
}

pm_status pm_live_replay_load(const char *path, const pm_scene *scene, pm_arena *arena,
                              double **value, int64_t *steps) {
    if (scene->network.nlive == 0) {
        return pm_fail(PM_ECONFIG, "scene %s has no live inputs to be replayed", scene->name);
    }
    const protected_load context = {path, scene};
    PM_TRY(pm_hdf5_try(path, try_load, &context));
    return load(path, scene, arena, value, steps);
}
