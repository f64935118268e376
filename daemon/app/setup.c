// Loads a scene with all that a run of it needs.
#include "app/setup.h"

#include <errno.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "app/connect.h"
#include "base/digest.h"
#include "transport/transport.h"

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

static pm_status find_initial(pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    setup->initial = pm_arena_array(&setup->arena, (size_t)scene->nz, sizeof(double));
    if (setup->initial == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", scene->path);
    }
    if (setup->reference != NULL) {
        pm_columns_to_state(&setup->columns, pm_setup_truth(setup, 0), setup->initial);
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

static pm_status override(pm_scene *scene, const pm_run_options *options) {
    if (options->url != NULL) {
        PM_TRY(pm_transport_check(options->url));
        scene->url = options->url;
    }
    if (options->steps != 0) {
        scene->steps = (int)options->steps;
    }
    return options->in_process ? pm_scene_join_processes(scene) : PM_OK;
}

pm_status pm_setup_load(pm_setup *setup, const pm_run_options *options, pm_purpose purpose) {
    *setup = (pm_setup){0};
    PM_TRY(pm_scene_load(&setup->scene, options->scene));
    const pm_scene *scene = setup->scene;
    PM_TRY(pm_system_load(&setup->system, scene, options->weights));
    // This follows the digest, because hosts may have different URLs and only one of them counts
    // steps.
    PM_TRY(pm_connect_check(setup->scene));
    PM_TRY(override(setup->scene, options));
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
    if (scene->reference != NULL && (follows || purpose != PM_TO_SERVE)) {
        PM_TRY(load_reference(setup));
    }
    PM_TRY(pm_boundary_input_bind(&setup->boundary_input, scene, setup->reference, setup->stride,
                                  &setup->arena));
    if (setup->reference != NULL) {
        pm_boundary_input_follow(&setup->boundary_input, setup->reference,
                                 scene->reference_trajectory);
    }
    PM_TRY(find_initial(setup));
    setup->system->digest =
        pm_digest_doubles(setup->system->digest, setup->initial, (size_t)scene->nz);
    setup->system->digest = pm_boundary_input_digest(&setup->boundary_input, setup->system->digest);
    return PM_OK;
}

void pm_setup_free(pm_setup *setup) {
    pm_dataset_free(setup->reference);
    pm_system_free(setup->system);
    pm_scene_free(setup->scene);
    pm_arena_free(&setup->arena);
}

pm_status pm_setup_checkpoint(pm_setup *setup, const pm_run_options *options, const char *process,
                              const char **path) {
    const char *folder = options->checkpoint;
    *path = NULL;
    if (folder == NULL) {
        return PM_OK;
    }
    if (setup->scene->tolerance > 0) {
        return pm_fail(PM_ECONFIG,
                       "scene %s has a tolerance: the substeps of steps gone by are not kept, and "
                       "no process could return from its death: leave --checkpoint out",
                       setup->scene->name);
    }
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: cannot be made: %s", folder, strerror(errno));
    }
    *path = pm_arena_printf(&setup->arena, "%s/%s%s%s.checkpoint", folder, setup->scene->name,
                            process == NULL ? "" : "-", process == NULL ? "" : process);
    return *path == NULL ? pm_fail(PM_ENOMEM, "%s: out of memory", folder) : PM_OK;
}

const double *pm_setup_truth(const pm_setup *setup, int time_id) {
    return pm_dataset_state(setup->reference, setup->scene->reference_trajectory, time_id);
}
