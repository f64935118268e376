// The lookahead follows from the scene: its window, its number of rounds, and its checkpoints.
#include "lockstep/lookahead.h"

#include "scene/integrator.h"

#define MOST_STEPS 16 // half of them make one report

int pm_lookahead(const pm_scene *scene) {
    const int half = scene->network.checkpoint / 2, most = half < MOST_STEPS ? half : MOST_STEPS;
    const int window = scene->network.window,
              own = window > 1 ? window / 2 : 1; // steps in a report
    const pm_integrator *integrator = scene->physics.integrator;
    const bool one_round =
        integrator != NULL && integrator->nstage == 1 && scene->physics.substeps == 1;
    const bool shown = scene->network.nprocess > 1 && scene->physics.tolerance == 0 &&
                       scene->network.nlive == 0 && one_round;
    return shown && most / 2 > 2 * own ? most : window;
}

bool pm_lookahead_uses_fluxes(const pm_scene *scene) {
    return pm_lookahead(scene) > scene->network.window;
}

int64_t pm_checkpoint_interval(const pm_scene *scene) {
    const int64_t least = 2 * (int64_t)scene->network.window;
    return scene->network.checkpoint > least ? scene->network.checkpoint : least;
}

const char *pm_checkpoint_owner(pm_arena *arena, const pm_scene *scene, const char *process) {
    return pm_arena_printf(arena, "%s of scene %s", process, scene->name);
}
