// All subsystems in one loop. In every round all of them expose before any is coupled, and all are
// coupled before any advances. Many subsystems with few models are a batch instead.
#include "sim/monolithic.h"

#include <stdlib.h>

#include "sim/batch.h"
#include "sim/step_controller.h"

// Fewer subsystems are stepped one by one, as are those of which most lanes of a batch would be
// empty. The bits are the same.
#define FEWEST_IN_BATCH 16

struct pm_monolithic {
    const pm_system *system;
    int count;
    pm_subsystem **subsystem; // [count]
    int (*position)[2];       // [nport][end] which port of the subsystem at that end it is
    pm_batch *batch;          // NULL: the subsystems are stepped one by one
    pm_sample *sample;
    bool stale; // the sample has not been filled since the batch has moved
    pm_step_controller controller;
};

// Lets the first subsystem of each port evaluate its law for both.
static pm_status share_ports(const pm_monolithic *m) {
    for (int i = 0; i < m->system->scene->nport; ++i) {
        const int *end = m->system->scene->port[i].subsystem;
        if (end[0] < 0 || end[1] < 0) {
            continue;
        }
        const int first = end[0] < end[1] ? 0 : 1;
        PM_TRY(pm_subsystem_share(m->subsystem[end[first]], m->position[i][first],
                                  m->subsystem[end[1 - first]], m->position[i][1 - first]));
    }
    return PM_OK;
}

static pm_status open_batch(pm_monolithic *m) {
    if (m->system->scene->nsubsystem < FEWEST_IN_BATCH) {
        return PM_OK;
    }
    PM_TRY(pm_batch_open(&m->batch, m->system));
    if (m->batch != NULL && pm_batch_lanes(m->batch) > 2 * m->system->scene->nsubsystem) {
        pm_batch_close(m->batch);
        m->batch = NULL;
    }
    return PM_OK;
}

static pm_status open_subsystems(pm_monolithic *m) {
    const pm_scene *scene = m->system->scene;
    m->subsystem = calloc((size_t)scene->nsubsystem, sizeof *m->subsystem);
    m->position = calloc((size_t)scene->nport + 1, sizeof *m->position);
    if (m->subsystem == NULL || m->position == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a monolithic run");
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        PM_TRY(pm_subsystem_open(&m->subsystem[i], m->system, i));
        m->count = i + 1;
        for (int j = 0; j < pm_subsystem_nport(m->subsystem[i]); ++j) {
            const int port = pm_subsystem_port_id(m->subsystem[i], j);
            m->position[port][pm_subsystem_end(m->subsystem[i], j)] = j;
        }
    }
    return share_ports(m);
}

static pm_status open_all(pm_monolithic *m) {
    const pm_scene *scene = m->system->scene;
    PM_TRY(open_batch(m));
    if (m->batch == NULL) {
        PM_TRY(open_subsystems(m));
    }
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
        for (int i = 0; i < monolithic->count; ++i) {
            pm_subsystem_close(monolithic->subsystem[i]);
        }
        pm_batch_close(monolithic->batch);
        free(monolithic->subsystem);
        free(monolithic->position);
        pm_sample_free(monolithic->sample);
        free(monolithic);
    }
}

static void fill_sample(pm_monolithic *m) {
    for (int i = 0; i < m->count; ++i) {
        pm_subsystem_fill_sample(m->subsystem[i], m->sample);
    }
}

void pm_monolithic_set_boundary_input(pm_monolithic *monolithic,
                                      const pm_boundary_input *boundary_input) {
    for (int i = 0; i < monolithic->count; ++i) {
        pm_subsystem_set_boundary_input(monolithic->subsystem[i], boundary_input);
    }
}

static void set_substeps(pm_monolithic *m) {
    for (int i = 0; i < m->count; ++i) {
        pm_subsystem_set_substeps(m->subsystem[i], m->controller.substeps);
    }
}

void pm_monolithic_set_state(pm_monolithic *monolithic, const double *z) {
    // This cannot fail, since it succeeded when the object was opened.
    (void)pm_step_controller_init(&monolithic->controller, monolithic->system->scene);
    set_substeps(monolithic);
    monolithic->sample->step = 0;
    monolithic->sample->time = 0;
    if (monolithic->batch != NULL) {
        pm_batch_set_state(monolithic->batch, z);
        monolithic->stale = true;
        return;
    }
    for (int i = 0; i < monolithic->count; ++i) {
        pm_subsystem_set_state(monolithic->subsystem[i],
                               z + monolithic->system->scene->subsystem[i].first);
    }
    fill_sample(monolithic);
}

static void couple_ports(pm_monolithic *m, int subsystem_id) {
    pm_subsystem *s = m->subsystem[subsystem_id];
    for (int j = 0; j < pm_subsystem_nport(s); ++j) {
        const int port = pm_subsystem_port_id(s, j);
        const pm_end other = pm_subsystem_end(s, j) == PM_END_A ? PM_END_B : PM_END_A;
        const int neighbour = m->system->scene->port[port].subsystem[other];
        pm_subsystem_couple(
            s, j,
            neighbour < 0 ? NULL
                          : pm_subsystem_values(m->subsystem[neighbour], m->position[port][other]));
    }
}

static pm_status step_subsystems(pm_monolithic *m) {
    while (!pm_subsystem_completes_step(m->subsystem[0])) {
        for (int i = 0; i < m->count; ++i) {
            pm_subsystem_expose(m->subsystem[i]);
        }
        for (int i = 0; i < m->count; ++i) {
            pm_subsystem_bulk(m->subsystem[i]);
            couple_ports(m, i);
        }
        for (int i = 0; i < m->count; ++i) {
            pm_subsystem_advance(m->subsystem[i]);
        }
    }
    for (int i = 0; i < m->count; ++i) {
        PM_TRY(pm_subsystem_end_step(m->subsystem[i]));
    }
    fill_sample(m);
    return PM_OK;
}

pm_status pm_monolithic_step(pm_monolithic *monolithic) {
    pm_monolithic *m = monolithic;
    if (m->batch == NULL) {
        PM_TRY(step_subsystems(m));
    } else {
        PM_TRY(pm_batch_step(m->batch));
        m->stale = true;
    }
    ++m->sample->step;
    m->sample->time = pm_scene_time(m->system->scene, 0, m->sample->step);
    pm_step_controller_note(&m->controller, m->sample);
    set_substeps(m);
    return PM_OK;
}

int pm_monolithic_substeps(const pm_monolithic *monolithic) {
    return monolithic->controller.substeps;
}

const pm_sample *pm_monolithic_sample(pm_monolithic *monolithic) {
    if (monolithic->stale) {
        pm_batch_fill_sample(monolithic->batch, monolithic->sample);
        monolithic->stale = false;
    }
    return monolithic->sample;
}
