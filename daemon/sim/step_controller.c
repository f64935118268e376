// A predictive controller of the number of substeps.
#include "sim/step_controller.h"

#include <math.h>

// The controller aims at this fraction of the tolerance, so that few steps exceed the tolerance.
#define AIM 0.5
// The number of substeps rises and falls by at most these factors from one step to the next.
#define MOST_RISE 8.0
#define MOST_FALL 2.0

// Rounds the number of substeps up and limits it to the range from the scene's substeps to
// PM_MOST_SUBSTEPS.
static int whole(const pm_scene *scene, double substeps) {
    return (int)fmin(fmax(ceil(substeps), scene->physics.substeps), PM_MOST_SUBSTEPS);
}

pm_status pm_step_controller_init(pm_step_controller *controller, const pm_scene *scene) {
    const bool chosen = pm_physics_is_adaptive(&scene->physics);
    *controller =
        (pm_step_controller){.scene = scene,
                             .integrator = scene->physics.integrator,
                             .substeps = chosen ? whole(scene, MOST_RISE * scene->physics.substeps)
                                                : scene->physics.substeps};
    if (chosen && controller->integrator->embedded == 0) {
        return pm_fail(
            PM_ECONFIG,
            "%s: integrator %s does not estimate its error; heun, rk4 and rk4_balanced do",
            scene->physics.integrator_at, scene->physics.integrator->name);
    }
    return chosen && scene->physics.substeps > PM_MOST_SUBSTEPS
               ? pm_fail(PM_ECONFIG,
                         "substeps: %d are the fewest that a tolerance may choose, at most %d are "
                         "possible",
                         scene->physics.substeps, PM_MOST_SUBSTEPS)
               : PM_OK;
}

void pm_step_controller_note(pm_step_controller *controller, const pm_sample *sample) {
    const pm_scene *scene = controller->scene;
    if (!pm_physics_is_adaptive(&scene->physics) || sample->step == 0) {
        return;
    }
    double error = 0;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        error = fmax(error, sample->error[i]);
    }
    // The error is expected to change over the next step as it did over this one.
    const double trend = controller->expected > 0 ? fmax(error / controller->expected, 1) : 1;
    const double order = controller->integrator->embedded + 1;
    const double factor = pow(error * trend / (AIM * scene->physics.tolerance), 1 / order);
    const int next =
        whole(scene, controller->substeps * fmin(fmax(factor, 1 / MOST_FALL), MOST_RISE));
    controller->expected = error * pow((double)controller->substeps / next, order);
    controller->substeps = next;
}
