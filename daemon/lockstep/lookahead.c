// The lookahead follows from the scene: its window, its number of rounds, and its checkpoints.
#include "lockstep/lookahead.h"

#include "scene/integrator.h"

#define MOST_STEPS 16 // half of them make one report

static bool has_one_round(const pm_scene *scene) {
    const pm_integrator *integrator = scene->integrator;
    return integrator != NULL && integrator->nstage == 1 && scene->substeps == 1;
}

int pm_lookahead(const pm_scene *scene) {
    const int half = scene->checkpoint / 2, most = half < MOST_STEPS ? half : MOST_STEPS;
    const int window = scene->window, own = window > 1 ? window / 2 : 1; // steps in a report
    const bool shown =
        scene->nprocess > 1 && scene->tolerance == 0 && scene->nlive == 0 && has_one_round(scene);
    return shown && most / 2 > 2 * own ? most : window;
}

bool pm_lookahead_uses_fluxes(const pm_scene *scene) {
    return pm_lookahead(scene) > scene->window;
}
