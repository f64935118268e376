// Loads a scene and puts the options of the command line in place of its settings.
#include "app/prepare.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>

#include "app/connect.h"
#include "transport/transport.h"

pm_status pm_prepare(pm_setup *setup, const pm_run_options *options, pm_purpose purpose) {
    pm_scene *scene = NULL;
    *setup = (pm_setup){0};
    PM_TRY(options->text == NULL ? pm_scene_load(&scene, options->scene)
                                 : pm_scene_parse(&scene, options->text, options->scene));
    PM_TRY(pm_setup_open(setup, scene, options->weights));
    setup->system->compiled = options->compiled;
    PM_TRY(pm_connect_check(scene));
    if (options->url != NULL) {
        PM_TRY(pm_transport_check(options->url));
    }
    if (options->steps != 0) { // not part of the digest, because only the coordinator counts steps
        scene->run.steps = (int)options->steps;
    }
    if (options->in_process) {
        PM_TRY(pm_scene_merge_processes(scene));
    }
    PM_TRY(pm_setup_complete(setup, purpose));
    return options->replay == NULL ? PM_OK : pm_setup_replay(setup, options->replay);
}

pm_status pm_prepare_check_steps(const pm_setup *setup, const pm_run_options *options) {
    const pm_scene *scene = setup->scene;
    const pm_scene_boundary_input *ending =
        pm_boundary_input_ending(&setup->boundary_input, scene->run.steps - 1L);
    if (setup->replay != NULL && setup->replayed < scene->run.steps && !options->held) {
        return pm_fail(PM_EDATA,
                       "scene %s: expected a run of at most %lld steps, found %d: %s: the "
                       "recording that is replayed ends after step %lld",
                       scene->name, (long long)setup->replayed, scene->run.steps,
                       setup->replay_path, (long long)setup->replayed);
    }
    if (ending == NULL || options->held) {
        return PM_OK;
    }
    return pm_fail(PM_EDATA,
                   "scene %s: expected a run of at most %ld steps, found %d: boundary input %s "
                   "follows trajectory %d of %s, which ends after %ld steps",
                   scene->name, setup->boundary_input.end, scene->run.steps, ending->name,
                   scene->run.reference_trajectory, scene->run.reference,
                   setup->boundary_input.end);
}

pm_status pm_prepare_checkpoint(pm_setup *setup, const pm_run_options *options, const char *process,
                                const char **path) {
    const char *folder = options->checkpoint;
    *path = NULL;
    if (folder == NULL) {
        return PM_OK;
    }
    if (pm_physics_is_adaptive(&setup->scene->physics)) {
        return pm_fail(PM_ECONFIG,
                       "scene %s has a tolerance, and --checkpoint needs fixed substeps: a "
                       "restarted process could not repeat the substeps of earlier steps",
                       setup->scene->name);
    }
    if (setup->scene->network.nlive > 0) {
        return pm_fail(PM_ECONFIG,
                       "scene %s has live inputs, and a process that restarts from a --checkpoint "
                       "could not repeat earlier steps: they do not come again",
                       setup->scene->name);
    }
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: cannot be made: %s", folder, strerror(errno));
    }
    *path = pm_arena_printf(&setup->arena, "%s/%s%s%s.checkpoint", folder, setup->scene->name,
                            process == NULL ? "" : "-", process == NULL ? "" : process);
    return pm_arena_status(&setup->arena, "%s", folder);
}
