// From the scene: how many rounds a step has.
#include "lockstep/lookahead.h"

#include "sim/integrator.h"

#define LEAD 16 // steps: of them half make one report

static bool has_one_round(const pm_scene *scene) {
    const pm_integrator *integrator = pm_integrator_find(scene->integrator);
    return integrator != NULL && integrator->nstage == 1 && scene->substeps == 1;
}

int pm_lookahead(const pm_scene *scene) {
    const int half = scene->checkpoint / 2, most = half < LEAD ? half : LEAD;
    const int window = scene->window, own = window > 1 ? window / 2 : 1; // steps in a report
    const bool told = scene->nprocess > 1 && scene->tolerance == 0 && has_one_round(scene);
    return told && most / 2 > 2 * own ? most : window;
}

bool pm_lookahead_is_heard(const pm_scene *scene) {
    return pm_lookahead(scene) > scene->window;
}
