// The number of substeps after each step.
#include "sim/step_controller.h"

#include <math.h>

// Of the tolerance that is aimed at, so that few steps exceed it.
#define AIM 0.5
// At most so many times more or fewer substeps than in the step before.
#define MOST_RISE 8.0
#define MOST_FALL 2.0

// Neither fewer than the scene has nor more than there may be.
static int whole(const pm_scene *scene, double substeps) {
    return (int)fmin(fmax(ceil(substeps), scene->substeps), PM_MOST_SUBSTEPS);
}

pm_status pm_step_controller_init(pm_step_controller *pace, const pm_scene *scene) {
    const bool chosen = scene->tolerance > 0;
    *pace = (pm_step_controller){.scene = scene,
                                 .integrator = pm_integrator_find(scene->integrator),
                                 .substeps = chosen ? whole(scene, MOST_RISE * scene->substeps)
                                                    : scene->substeps};
    if (chosen && pace->integrator->embedded == 0) {
        return pm_fail(
            PM_ECONFIG,
            "%s: integrator %s does not estimate its error; heun, rk4 and rk4_balanced do",
            scene->integrator_at, scene->integrator);
    }
    return chosen && scene->substeps > PM_MOST_SUBSTEPS
               ? pm_fail(PM_ECONFIG,
                         "substeps: %d are the fewest that a tolerance may choose, at most %d are "
                         "possible",
                         scene->substeps, PM_MOST_SUBSTEPS)
               : PM_OK;
}

void pm_step_controller_note(pm_step_controller *pace, const pm_sample *sample) {
    const pm_scene *scene = pace->scene;
    if (!(scene->tolerance > 0) || sample->step == 0) {
        return;
    }
    double error = 0;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        error = fmax(error, sample->error[i]);
    }
    // As the error changed over this step, so it will over the next.
    const double trend = pace->expected > 0 ? fmax(error / pace->expected, 1) : 1;
    const double order = pace->integrator->embedded + 1;
    const double factor = pow(error * trend / (AIM * scene->tolerance), 1 / order);
    const int next = whole(scene, pace->substeps * fmin(fmax(factor, 1 / MOST_FALL), MOST_RISE));
    pace->expected = error * pow((double)pace->substeps / next, order);
    pace->substeps = next;
}
