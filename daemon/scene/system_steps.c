// Checks that a scene has the integrator and step for which its weights were trained.
#include <math.h>
#include <string.h>

#include "scene/system.h"

#define SAME_STEP 1e-9 // relative: steps are quotients of numbers written in decimals

// Returns true if a rate is valid only for the step of its training. Known models and weights
// without a record of their step are valid for any step.
static bool hold_for_one_step(const pm_network_spec *rate, const pm_provenance *p) {
    return rate->message != NULL && p->step > 0 &&
           rate->message->within <= p->step * (1 + SAME_STEP);
}

static pm_status check_rate(const pm_scene *scene, const pm_network_spec *rate,
                            const pm_provenance *p, const char *at, const char *name) {
    const double step = scene->dt / scene->substeps;
    if (!hold_for_one_step(rate, p) ||
        (strcmp(p->integrator, scene->integrator->name) == 0 && scene->tolerance == 0 &&
         fabs(p->step - step) <= SAME_STEP * step)) {
        return PM_OK;
    }
    return pm_fail(PM_EWEIGHTS,
                   "%s: %s: the weights %s predict the change within a step of %.9g s of "
                   "%.40s, and hold for no other; the scene takes steps of %s%.9g s of %s",
                   at, name, p->path, p->step, p->integrator, scene->tolerance > 0 ? "up to " : "",
                   step, scene->integrator->name);
}

pm_status pm_system_check_steps(const pm_system *system) {
    const pm_scene *scene = system->scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_scene_subsystem *part = &scene->subsystem[i];
        PM_TRY(check_rate(scene, &system->part[i]->spec.rate, system->part_provenance[i],
                          part->weights_at, part->name));
    }
    for (int i = 0; i < scene->nport; ++i) {
        const pm_scene_port *port = &scene->port[i];
        PM_TRY(check_rate(scene, &system->port[i]->spec.rate, system->port_provenance[i],
                          port->weights_at, port->name));
    }
    return PM_OK;
}
