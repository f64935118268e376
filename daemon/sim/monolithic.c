// A monolithic run is a process that steps every subsystem of the scene: no end is remote.
#include "sim/monolithic.h"

#include <stdlib.h>

#include "sim/local_subsystems.h"
#include "sim/step_controller.h"

struct pm_monolithic {
    const pm_system *system;
    pm_local_subsystems *subsystems;
    pm_sample *sample;
    bool stale;                            // the sample has not been filled since the last step
    pm_step_controller controller, before; // now, and before the last step
    int substeps, substeps_before;         // of the last step, and of the one before it
};

pm_status pm_monolithic_open(pm_monolithic **monolithic, const pm_system *system) {
    pm_monolithic *m = NULL;
    PM_TRY(PM_NEW(m, "a monolithic run"));
    pm_status status;
    m->system = system;
    PM_TRY_DONE(pm_local_subsystems_open(&m->subsystems, system, 0, NULL));
    PM_TRY_DONE(pm_step_controller_init(&m->controller, system->scene));
    PM_TRY_DONE(pm_sample_new(&m->sample, system->scene));
    *monolithic = m;
    m = NULL;
done:
    pm_monolithic_close(m);
    return status;
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
    m->substeps = m->controller.substeps;
    pm_local_subsystems_set_substeps(m->subsystems, m->controller.substeps);
    pm_local_subsystems_set_state(m->subsystems, z);
    m->sample->step = 0;
    m->sample->time = 0;
    m->stale = true;
}

pm_status pm_monolithic_check_state(pm_monolithic *monolithic, const double *z) {
    return pm_local_subsystems_check_state(monolithic->subsystems, z);
}

void pm_monolithic_set_step(pm_monolithic *monolithic, long step) {
    pm_local_subsystems_set_step(monolithic->subsystems, step);
    monolithic->sample->step = step;
    monolithic->sample->time = pm_scene_time(monolithic->system->scene, step);
}

void pm_monolithic_record(pm_monolithic *monolithic, pm_serializer *serializer) {
    pm_step_controller *controller = &monolithic->controller;
    pm_local_subsystems_record(monolithic->subsystems, serializer);
    pm_serializer_put_int(serializer, "substeps", &controller->substeps);
    pm_serializer_put(serializer, "expected error", &controller->expected, 1);
    if (pm_serializer_restores(serializer)) {
        monolithic->substeps = controller->substeps;
        monolithic->stale = true;
        pm_local_subsystems_set_substeps(monolithic->subsystems, controller->substeps);
    }
}

pm_status pm_monolithic_step(pm_monolithic *monolithic) {
    pm_monolithic *m = monolithic;
    while (!pm_local_subsystems_completes_step(m->subsystems)) {
        pm_local_subsystems_bulk(m->subsystems);
        pm_local_subsystems_couple(m->subsystems);
        pm_local_subsystems_advance(m->subsystems);
    }
    PM_TRY(pm_local_subsystems_end_step(m->subsystems));
    m->before = m->controller;
    m->substeps_before = m->substeps;
    m->substeps = m->controller.substeps;
    m->stale = true;
    ++m->sample->step;
    m->sample->time = pm_scene_time(m->system->scene, m->sample->step);
    if (pm_physics_is_adaptive(&m->system->scene->physics)) {
        pm_step_controller_note(&m->controller, pm_monolithic_sample(m));
    }
    pm_local_subsystems_set_substeps(m->subsystems, m->controller.substeps);
    return PM_OK;
}

pm_status pm_monolithic_keep_steps(pm_monolithic *monolithic) {
    return pm_local_subsystems_keep_steps(monolithic->subsystems);
}

void pm_monolithic_undo_step(pm_monolithic *monolithic) {
    pm_monolithic *m = monolithic;
    pm_local_subsystems_undo_step(m->subsystems);
    m->controller = m->before;
    m->substeps = m->substeps_before;
    --m->sample->step;
    m->sample->time = pm_scene_time(m->system->scene, m->sample->step);
    m->stale = true;
    if (pm_physics_is_adaptive(&m->system->scene->physics)) { // the sample names the substeps
        pm_local_subsystems_set_substeps(m->subsystems, m->substeps);
        (void)pm_monolithic_sample(m);
    }
    pm_local_subsystems_set_substeps(m->subsystems, m->controller.substeps);
}

pm_status pm_monolithic_copy(pm_monolithic *monolithic, pm_monolithic *from) {
    pm_monolithic *m = monolithic;
    pm_serializer counter = pm_serializer_count("copy");
    pm_monolithic_record(from, &counter);
    double *number = calloc((size_t)counter.count, sizeof *number);
    PM_TRY(pm_allocated(number, "a copy of scene %s", m->system->scene->name));
    pm_serializer save = pm_serializer_save("copy", number);
    pm_serializer restore = pm_serializer_restore("copy", number);
    pm_monolithic_record(from, &save);
    pm_monolithic_record(m, &restore);
    free(number);
    pm_local_subsystems_take_fluxes(m->subsystems, from->subsystems);
    m->sample->step = from->sample->step;
    m->sample->time = from->sample->time;
    // The sample names the substeps of the last step.
    m->substeps = from->substeps;
    pm_local_subsystems_set_substeps(m->subsystems, m->substeps);
    (void)pm_monolithic_sample(m);
    pm_local_subsystems_set_substeps(m->subsystems, m->controller.substeps);
    return PM_OK;
}

void pm_monolithic_efforts(pm_monolithic *monolithic, double *dE, double *reaction) {
    pm_local_subsystems_efforts(monolithic->subsystems, dE, reaction);
}

int pm_monolithic_substeps(const pm_monolithic *monolithic) {
    return monolithic->controller.substeps;
}

const pm_sample *pm_monolithic_sample(pm_monolithic *monolithic) {
    if (monolithic->stale) {
        pm_local_subsystems_fill_sample(monolithic->subsystems,
                                        monolithic->system->scene->physics.nsubsystem,
                                        monolithic->sample);
        monolithic->stale = false;
    }
    return monolithic->sample;
}

const pm_sample *pm_monolithic_sums(pm_monolithic *monolithic, pm_tally *tally) {
    *tally = (pm_tally){0};
    pm_local_subsystems_tally(monolithic->subsystems, tally);
    pm_local_subsystems_fill_sample(monolithic->subsystems, PM_SCENE_LISTED, monolithic->sample);
    return monolithic->sample;
}
