// A monolithic run is a process that steps every subsystem of the scene: no end is remote.
#include "sim/monolithic.h"

#include <stdlib.h>

#include "sim/local_subsystems.h"
#include "sim/step_controller.h"

struct pm_monolithic {
    const pm_system *system;
    pm_local_subsystems *subsystems;
    pm_sample *sample;
    bool stale; // the sample has not been filled since the last step
    pm_step_controller controller;
};

static pm_status open_all(pm_monolithic *m) {
    const pm_scene *scene = m->system->scene;
    PM_TRY(pm_local_subsystems_open(&m->subsystems, m->system, scene->nsubsystem, NULL));
    PM_TRY(pm_step_controller_init(&m->controller, scene));
    return pm_sample_new(&m->sample, scene);
}

pm_status pm_monolithic_open(pm_monolithic **monolithic, const pm_system *system) {
    pm_monolithic *m = calloc(1, sizeof *m);
    if (m == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a monolithic run");
    }
    m->system = system;
    const pm_status status = open_all(m);
    if (status != PM_OK) {
        pm_monolithic_close(m);
        return status;
    }
    *monolithic = m;
    return PM_OK;
}

void pm_monolithic_close(pm_monolithic *monolithic) {
    if (monolithic != NULL) {
        pm_local_subsystems_close(monolithic->subsystems);
        pm_sample_free(monolithic->sample);
        free(monolithic);
    }
}

void pm_monolithic_set_boundary_input(pm_monolithic *monolithic,
                                      const pm_boundary_input *boundary_input) {
    pm_local_subsystems_set_boundary_input(monolithic->subsystems, boundary_input);
}

void pm_monolithic_set_state(pm_monolithic *monolithic, const double *z) {
    pm_monolithic *m = monolithic;
    // This cannot fail, since it succeeded when the object was opened.
    (void)pm_step_controller_init(&m->controller, m->system->scene);
    pm_local_subsystems_set_substeps(m->subsystems, m->controller.substeps);
    pm_local_subsystems_set_state(m->subsystems, z);
    m->sample->step = 0;
    m->sample->time = 0;
    m->stale = true;
}

static pm_status step_subsystems(pm_local_subsystems *s) {
    while (!pm_local_subsystems_completes_step(s)) {
        pm_local_subsystems_expose(s);
        pm_local_subsystems_bulk(s);
        pm_local_subsystems_couple(s);
        pm_local_subsystems_advance(s);
    }
    return pm_local_subsystems_end_step(s);
}

pm_status pm_monolithic_step(pm_monolithic *monolithic) {
    pm_monolithic *m = monolithic;
    PM_TRY(step_subsystems(m->subsystems));
    m->stale = true;
    ++m->sample->step;
    m->sample->time = pm_scene_time(m->system->scene, 0, m->sample->step);
    if (m->system->scene->tolerance > 0) {
        pm_step_controller_note(&m->controller, pm_monolithic_sample(m));
    }
    pm_local_subsystems_set_substeps(m->subsystems, m->controller.substeps);
    return PM_OK;
}

int pm_monolithic_substeps(const pm_monolithic *monolithic) {
    return monolithic->controller.substeps;
}

const pm_sample *pm_monolithic_sample(pm_monolithic *monolithic) {
    if (monolithic->stale) {
        pm_local_subsystems_fill_sample(monolithic->subsystems, monolithic->sample);
        monolithic->stale = false;
    }
    return monolithic->sample;
}

const pm_sample *pm_monolithic_sums(pm_monolithic *monolithic, pm_tally *tally) {
    *tally = (pm_tally){0};
    pm_local_subsystems_tally(monolithic->subsystems, tally);
    pm_local_subsystems_fill_first(monolithic->subsystems, PM_SCENE_LISTED, monolithic->sample);
    return monolithic->sample;
}
