// Loads all that a run of a scene needs.
#include "library/setup.h"

#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "base/digest.h"
#include "library/estimated_start.h"
#include "scene/live_replay.h"

// Relative difference of two time steps that are meant to be equal; decimal fractions are rounded.
#define TIME_TOLERANCE 1e-9

// Returns the first subsystem whose initial state must come from the reference, or NULL.
static const pm_scene_subsystem *needs_reference(const pm_scene *scene) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (scene->subsystem[i].initial == NULL) {
            return &scene->subsystem[i];
        }
    }
    return NULL;
}

static pm_status load_reference(pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    const pm_status status = pm_dataset_load(&setup->reference, scene->reference);
    if (status != PM_OK) {
        return pm_fail(status, "%s: %s", scene->reference_at, pm_error());
    }
    const pm_dataset *reference = setup->reference;
    PM_TRY(pm_system_check_dataset(setup->system, reference, scene->reference));
    if (scene->reference_trajectory < 0 || scene->reference_trajectory >= reference->ntrajectory) {
        return pm_fail(PM_ECONFIG, "%s: trajectory %d of the reference: %s holds %d, from 0",
                       scene->reference_trajectory_at, scene->reference_trajectory,
                       scene->reference, reference->ntrajectory);
    }
    PM_TRY(pm_columns_bind(&setup->columns, scene, reference, &setup->arena));
    const double stride = round(reference->dt / scene->dt);
    if (stride < 1 || fabs(reference->dt - stride * scene->dt) > TIME_TOLERANCE * reference->dt) {
        return pm_fail(PM_EDATA,
                       "%s: %s: dt %g s: expected a whole multiple of the scene's dt %g s",
                       scene->reference_at, scene->reference, reference->dt, scene->dt);
    }
    setup->stride = (int)stride;
    return PM_OK;
}

// Estimates the state in which the measurements of the reference begin.
static pm_status estimate_initial(pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    pm_dataset *states = NULL;
    pm_columns columns;
    pm_status status;
    PM_TRY_DONE(pm_estimated_start(scene, setup->weights, &states));
    PM_TRY_DONE(pm_columns_bind(&columns, scene, states, &setup->arena));
    pm_columns_to_state(&columns, pm_dataset_state(states, 0, 0), setup->initial);
done:
    pm_dataset_free(states);
    return status;
}

static pm_status find_initial(pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    setup->initial = pm_arena_array(&setup->arena, (size_t)scene->nz, sizeof(double));
    if (setup->initial == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", scene->path);
    }
    if (setup->reference != NULL) {
        pm_columns_to_state(&setup->columns, pm_setup_truth(setup, 0), setup->initial);
    }
    if (scene->reference_estimate > 0 && needs_reference(scene) != NULL) {
        PM_TRY(estimate_initial(setup));
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &scene->subsystem[i];
        if (subsystem->initial != NULL) {
            memcpy(setup->initial + subsystem->first, subsystem->initial,
                   (size_t)subsystem->layout.nz * sizeof(double));
        }
    }
    return PM_OK;
}

static pm_status start_live_inputs(pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    setup->live = pm_arena_array(&setup->arena, (size_t)scene->nlive, sizeof *setup->live);
    if (setup->live == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", scene->path);
    }
    for (int i = 0; i < scene->nlive_input; ++i) {
        const pm_scene_live_input *input = &scene->live_input[i];
        memcpy(setup->live + input->first, input->start,
               (size_t)input->count * sizeof *input->start);
    }
    setup->boundary_input.live = setup->live;
    return PM_OK;
}

pm_status pm_setup_open(pm_setup *setup, pm_scene *scene, const char *weights) {
    *setup = (pm_setup){.scene = scene, .weights = weights};
    return pm_system_load(&setup->system, scene, weights);
}

pm_status pm_setup_complete(pm_setup *setup, pm_purpose purpose) {
    const pm_scene *scene = setup->scene;
    const pm_scene_subsystem *needs = needs_reference(scene);
    if (needs != NULL && scene->reference == NULL) {
        if (purpose == PM_TO_DESCRIBE) {
            return PM_OK;
        }
        return pm_fail(PM_ECONFIG,
                       "%s: subsystem %s: no state to start from: expected `initial` in every "
                       "subsystem, or a `reference` trajectory",
                       needs->at, needs->name);
    }
    const bool follows = needs != NULL || scene->nboundary_input > 0;
    const bool states = scene->reference != NULL && scene->reference_estimate == 0;
    if (states && (follows || purpose != PM_TO_SERVE)) {
        PM_TRY(load_reference(setup));
    }
    PM_TRY(pm_boundary_input_bind(&setup->boundary_input, scene, setup->reference, setup->stride,
                                  &setup->arena));
    if (setup->reference != NULL) {
        pm_boundary_input_follow(&setup->boundary_input, setup->reference,
                                 scene->reference_trajectory);
    }
    PM_TRY(start_live_inputs(setup));
    PM_TRY(find_initial(setup));
    setup->system->digest =
        pm_digest_doubles(setup->system->digest, setup->initial, (size_t)scene->nz);
    setup->system->digest = pm_boundary_input_digest(&setup->boundary_input, setup->system->digest);
    return PM_OK;
}

pm_status pm_setup_replay(pm_setup *setup, const char *path) {
    setup->replay_path = path;
    return pm_live_replay_load(path, setup->scene, &setup->arena, &setup->replay, &setup->replayed);
}

static bool is_same_file(const char *path, const struct stat *other) {
    struct stat there;
    return path != NULL && path[0] != 0 && stat(path, &there) == 0 &&
           there.st_dev == other->st_dev && there.st_ino == other->st_ino;
}

const char *pm_setup_input(const pm_setup *setup, const char *path) {
    const pm_scene *scene = setup->scene;
    const char *const own[] = {scene->path, scene->key_file, scene->reference, setup->replay_path};
    struct stat file;
    if (stat(path, &file) != 0) {
        return NULL;
    }
    for (size_t i = 0; i < sizeof own / sizeof own[0]; ++i) {
        if (is_same_file(own[i], &file)) {
            return own[i];
        }
    }
    for (int i = 0; i < scene->nsubsystem + scene->nport; ++i) {
        const pm_provenance *weights = i < scene->nsubsystem
                                           ? setup->system->part_provenance[i]
                                           : setup->system->port_provenance[i - scene->nsubsystem];
        if (is_same_file(weights->path, &file)) {
            return weights->path;
        }
    }
    return NULL;
}

void pm_setup_free(pm_setup *setup) {
    pm_dataset_free(setup->reference);
    pm_system_free(setup->system);
    pm_scene_free(setup->scene);
    pm_arena_free(&setup->arena);
}

const double *pm_setup_truth(const pm_setup *setup, int time_id) {
    return pm_dataset_state(setup->reference, setup->scene->reference_trajectory, time_id);
}
