// From the scene: who has which neighbours, how many rounds a step has.
#include "net/lead.h"

#include "sim/integrator.h"

#define LEAD 16 // steps: of them half make one report

static bool are_neighbours(const pm_scene *scene, int a, int b) {
    for (int i = 0; i < scene->nport; ++i) {
        const pm_scene_port *port = &scene->port[i];
        if (!pm_scene_joins_processes(scene, port)) {
            continue;
        }
        const int p = scene->subsystem[port->subsystem[0]].process;
        const int q = scene->subsystem[port->subsystem[1]].process;
        if ((p == a && q == b) || (p == b && q == a)) {
            return true;
        }
    }
    return false;
}

static bool all_are_neighbours(const pm_scene *scene) {
    for (int a = 0; a < scene->nprocess; ++a) {
        for (int b = 0; b < a; ++b) {
            if (!are_neighbours(scene, a, b)) {
                return false;
            }
        }
    }
    return true;
}

static bool has_one_round(const pm_scene *scene) {
    const pm_integrator *integrator = pm_integrator_find(scene->integrator);
    return integrator != NULL && integrator->nstage == 1 && scene->substeps == 1;
}

int pm_lead(const pm_scene *scene) {
    const int half = scene->checkpoint / 2, most = half < LEAD ? half : LEAD;
    const bool told = scene->nprocess > 1 && scene->tolerance == 0 &&
                      (all_are_neighbours(scene) || has_one_round(scene));
    return told && most > scene->window ? most : scene->window;
}

bool pm_lead_is_heard(const pm_scene *scene) {
    return pm_lead(scene) > scene->window && !all_are_neighbours(scene);
}
