// Loads all that a run of a scene needs.
#include "library/setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/child.h"
#include "base/digest.h"
#include "scene/live_replay.h"

// Relative difference of two time steps that are meant to be equal; decimal fractions are rounded.
#define TIME_TOLERANCE 1e-9

// Returns the first subsystem whose initial state must come from the reference, or NULL.
static const pm_scene_subsystem *needs_reference(const pm_scene *scene) {
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        if (scene->physics.subsystem[i].initial == NULL) {
            return &scene->physics.subsystem[i];
        }
    }
    return NULL;
}

static pm_status check_trajectory(const pm_setup *setup, const pm_dataset *dataset) {
    const pm_scene *scene = setup->scene;
    if (scene->run.reference_trajectory >= 0 &&
        scene->run.reference_trajectory < dataset->ntrajectory) {
        return PM_OK;
    }
    return pm_fail(PM_ECONFIG, "%s: trajectory %d of the reference: %s holds %d, from 0",
                   scene->run.reference_trajectory_at, scene->run.reference_trajectory,
                   scene->run.reference, dataset->ntrajectory);
}

static pm_status load_reference(pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    const pm_status status = pm_dataset_load(&setup->reference, scene->run.reference);
    if (status != PM_OK) {
        return pm_fail(status, "%s: %s", scene->run.reference_at, pm_error());
    }
    PM_TRY(pm_columns_convert(scene, setup->reference));
    const pm_dataset *reference = setup->reference;
    PM_TRY(pm_system_check_dataset(setup->system, reference, scene->run.reference));
    PM_TRY(check_trajectory(setup, reference));
    PM_TRY(pm_columns_bind(&setup->columns, scene, reference, &setup->arena));
    const double stride = round(reference->dt / scene->physics.dt);
    if (stride < 1 ||
        fabs(reference->dt - stride * scene->physics.dt) > TIME_TOLERANCE * reference->dt) {
        return pm_fail(
            PM_EDATA, "%s: %s: dt %g s: expected a whole multiple of the scene's dt %g s",
            scene->run.reference_at, scene->run.reference, reference->dt, scene->physics.dt);
    }
    setup->stride = (int)stride;
    return PM_OK;
}

// Reads what boundary inputs follow from the measurements in whose beginning a start is estimated.
static pm_status follow_measurements(pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    pm_dataset *data = NULL;
    pm_status status = pm_dataset_load_measured(&data, scene->run.reference, "z");
    if (status != PM_OK) {
        return pm_fail(status, "%s: %s", scene->run.reference_at, pm_error());
    }
    PM_TRY_DONE(pm_columns_convert(scene, data));
    PM_TRY_DONE(check_trajectory(setup, data));
    PM_TRY_DONE(pm_boundary_input_bind(&setup->boundary_input, scene, data,
                                       pm_boundary_input_stride(scene, data), &setup->arena));
    pm_boundary_input_follow(&setup->boundary_input, data, scene->run.reference_trajectory);
done:
    pm_dataset_free(data);
    return status;
}

// Estimates the state in which the measurements of the reference begin. This is the one place where
// what is served depends on the trainer: the program portmet-train computes the state, and writes
// it to a temporary file. It is looked for in the folder of the running program, then in PATH.
// PM_EFILE: the program is not found, or no temporary file can be made; PM_EDATA: it fails, after
// having said why on standard error.
static pm_status estimate_initial(pm_setup *setup) {
    static const char name[] = "portmet-train";
    const pm_scene *scene = setup->scene;
    const char *folder = getenv("TMPDIR"), *weights = setup->weights;
    char program[4096], output[4096], seconds[40], trajectory[40];
    const ssize_t length = readlink("/proc/self/exe", program, sizeof program - sizeof name - 1);
    program[length > 0 ? length : 0] = '\0';
    char *slash = strrchr(program, '/');
    if (slash != NULL) {
        memcpy(slash + 1, name, sizeof name);
    }
    if (slash == NULL || access(program, X_OK) != 0) {
        memcpy(program, name, sizeof name);
    }
    snprintf(output, sizeof output, "%s/portmet-start-XXXXXX", folder == NULL ? "/tmp" : folder);
    const int file = mkstemp(output);
    if (file < 0) {
        return pm_fail(PM_EFILE, "%s: cannot be made", output);
    }
    close(file);
    snprintf(seconds, sizeof seconds, "%.17g", scene->run.reference_estimate);
    snprintf(trajectory, sizeof trajectory, "%d", scene->run.reference_trajectory);
    char *argv[] = {program,
                    "evaluate",
                    (char *)scene->path,
                    "--data",
                    (char *)scene->run.reference,
                    "--estimate",
                    seconds,
                    "--trajectories",
                    trajectory,
                    "--states",
                    output,
                    weights == NULL ? NULL : "--weights",
                    (char *)weights,
                    NULL};
    pm_dataset *states = NULL;
    pm_columns columns;
    pm_status status = PM_OK;
    int code;
    const int error = pm_child_run(argv, true, &code);
    if (error != 0) {
        status = pm_fail(PM_EFILE, "%s: `estimate` needs the program portmet-train: %s",
                         scene->run.reference_at, strerror(error));
    } else if (code != 0) {
        status = pm_fail(PM_EDATA, "%s: portmet-train evaluate --estimate failed, see above",
                         scene->run.reference_at);
    }
    PM_TRY_DONE(status);
    PM_TRY_DONE(pm_dataset_load(&states, output));
    PM_TRY_DONE(pm_columns_bind(&columns, scene, states, &setup->arena));
    pm_columns_to_state(&columns, pm_dataset_state(states, 0, 0), setup->initial);
done:
    unlink(output);
    pm_dataset_free(states);
    return status;
}

// Allocates and finds the values of live inputs and the state at the start.
static pm_status find_start(pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    const size_t nlive = (size_t)scene->network.nlive, nz = (size_t)scene->physics.nz;
    setup->live = pm_arena_array(&setup->arena, nlive, sizeof *setup->live);
    setup->initial = pm_arena_array(&setup->arena, nz, sizeof *setup->initial);
    PM_TRY(pm_arena_status(&setup->arena, "%s", scene->path));
    for (int i = 0; i < scene->network.nlive_input; ++i) {
        const pm_scene_live_input *input = &scene->network.live_input[i];
        memcpy(setup->live + input->first, input->start,
               (size_t)input->count * sizeof *input->start);
    }
    setup->boundary_input.live = setup->live;
    if (setup->reference != NULL) {
        pm_columns_to_state(&setup->columns, pm_setup_truth(setup, 0), setup->initial);
    }
    if (scene->run.reference_estimate > 0 && needs_reference(scene) != NULL) {
        PM_TRY(estimate_initial(setup));
    }
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &scene->physics.subsystem[i];
        if (subsystem->initial != NULL) {
            memcpy(setup->initial + subsystem->first, subsystem->initial,
                   (size_t)subsystem->layout.nz * sizeof(double));
        }
    }
    return PM_OK;
}

pm_status pm_setup_open(pm_setup *setup, pm_scene *scene, const char *weights) {
    *setup = (pm_setup){.scene = scene, .weights = weights};
    return pm_system_load(&setup->system, scene, weights);
}

pm_status pm_setup_complete(pm_setup *setup, pm_purpose purpose) {
    const pm_scene *scene = setup->scene;
    const pm_scene_subsystem *needs = needs_reference(scene);
    if (needs != NULL && scene->run.reference == NULL) {
        if (purpose == PM_TO_DESCRIBE) {
            return PM_OK;
        }
        return pm_fail(PM_ECONFIG,
                       "%s: subsystem %s: no state to start from: expected `initial` in every "
                       "subsystem, or a `reference` trajectory",
                       needs->at, needs->name);
    }
    const bool follows = needs != NULL || scene->physics.nboundary_input > 0;
    const bool states = scene->run.reference != NULL && scene->run.reference_estimate == 0;
    if (states && (follows || purpose != PM_TO_SERVE)) {
        PM_TRY(load_reference(setup));
    }
    const bool estimates = scene->run.reference != NULL && !states;
    if (estimates && scene->physics.nboundary_input > 0) {
        PM_TRY(follow_measurements(setup));
    } else {
        PM_TRY(pm_boundary_input_bind(&setup->boundary_input, scene, setup->reference,
                                      setup->stride, &setup->arena));
    }
    if (setup->reference != NULL) {
        pm_boundary_input_follow(&setup->boundary_input, setup->reference,
                                 scene->run.reference_trajectory);
    }
    PM_TRY(find_start(setup));
    PM_TRY(pm_system_check_range(setup->system, 1, setup->initial, scene->path));
    setup->system->digest =
        pm_digest_doubles(setup->system->digest, setup->initial, (size_t)scene->physics.nz);
    setup->system->digest = pm_boundary_input_digest(&setup->boundary_input, setup->system->digest);
    return PM_OK;
}

pm_status pm_setup_replay(pm_setup *setup, const char *path) {
    setup->replay_path = path;
    return pm_live_replay_load(path, setup->scene, &setup->arena, &setup->replay, &setup->replayed);
}

void pm_setup_free(pm_setup *setup) {
    pm_dataset_free(setup->reference);
    pm_system_free(setup->system);
    pm_scene_free(setup->scene);
    pm_arena_free(&setup->arena);
}

const double *pm_setup_truth(const pm_setup *setup, int time_id) {
    return pm_dataset_state(setup->reference, setup->scene->run.reference_trajectory, time_id);
}
