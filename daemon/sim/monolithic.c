// All subsystems in one loop. Every port exchanges before any stage advances.
#include "sim/monolithic.h"

#include <stdlib.h>

#include "sim/step_controller.h"

struct pm_monolithic {
    const pm_system *system;
    int count;
    pm_subsystem **subsystem; // [count]
    // [nport][end]: which port of that end's subsystem it is
    int (*position)[2];
    pm_sample *sample;
    pm_step_controller pace;
};

// What both subsystems of a port would evaluate, the first one does.
static pm_status share_ports(const pm_monolithic *a) {
    for (int i = 0; i < a->system->scene->nport; ++i) {
        const int *end = a->system->scene->port[i].subsystem;
        if (end[0] < 0 || end[1] < 0) {
            continue;
        }
        const int first = end[0] < end[1] ? 0 : 1;
        PM_TRY(pm_subsystem_share(a->subsystem[end[first]], a->position[i][first],
                                  a->subsystem[end[1 - first]], a->position[i][1 - first]));
    }
    return PM_OK;
}

static pm_status open_all(pm_monolithic *a) {
    const pm_scene *scene = a->system->scene;
    a->subsystem = calloc((size_t)scene->nsubsystem, sizeof *a->subsystem);
    a->position = calloc((size_t)scene->nport + 1, sizeof *a->position);
    if (a->subsystem == NULL || a->position == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an assembly");
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        PM_TRY(pm_subsystem_open(&a->subsystem[i], a->system, i));
        a->count = i + 1;
        for (int j = 0; j < pm_subsystem_nport(a->subsystem[i]); ++j) {
            const int port = pm_subsystem_port_id(a->subsystem[i], j);
            a->position[port][pm_subsystem_end(a->subsystem[i], j)] = j;
        }
    }
    PM_TRY(share_ports(a));
    PM_TRY(pm_step_controller_init(&a->pace, scene));
    return pm_sample_new(&a->sample, scene);
}

pm_status pm_monolithic_open(pm_monolithic **assembly, const pm_system *system) {
    pm_monolithic *a = calloc(1, sizeof *a);
    if (a == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an assembly");
    }
    a->system = system;
    const pm_status status = open_all(a);
    if (status != PM_OK) {
        pm_monolithic_close(a);
        return status;
    }
    *assembly = a;
    return PM_OK;
}

void pm_monolithic_close(pm_monolithic *assembly) {
    if (assembly != NULL) {
        for (int i = 0; i < assembly->count; ++i) {
            pm_subsystem_close(assembly->subsystem[i]);
        }
        free(assembly->subsystem);
        free(assembly->position);
        pm_sample_free(assembly->sample);
        free(assembly);
    }
}

static void fill_sample(pm_monolithic *a) {
    for (int i = 0; i < a->count; ++i) {
        pm_subsystem_fill_sample(a->subsystem[i], a->sample);
    }
}

void pm_monolithic_set_boundary_input(pm_monolithic *assembly,
                                      const pm_boundary_input *boundary_input) {
    for (int i = 0; i < assembly->count; ++i) {
        pm_subsystem_set_boundary_input(assembly->subsystem[i], boundary_input);
    }
}

static void set_pace(pm_monolithic *a) {
    for (int i = 0; i < a->count; ++i) {
        pm_subsystem_set_substeps(a->subsystem[i], a->pace.substeps);
    }
}

void pm_monolithic_set_state(pm_monolithic *assembly, const double *z) {
    // Assemblies open with an integrator that is known.
    (void)pm_step_controller_init(&assembly->pace, assembly->system->scene);
    set_pace(assembly);
    for (int i = 0; i < assembly->count; ++i) {
        pm_subsystem_set_state(assembly->subsystem[i],
                               z + assembly->system->scene->subsystem[i].first);
    }
    assembly->sample->step = 0;
    assembly->sample->time = 0;
    fill_sample(assembly);
}

static void couple_ports(pm_monolithic *a, int subsystem_id) {
    pm_subsystem *s = a->subsystem[subsystem_id];
    for (int j = 0; j < pm_subsystem_nport(s); ++j) {
        const int port = pm_subsystem_port_id(s, j);
        const pm_end other = pm_subsystem_end(s, j) == PM_END_A ? PM_END_B : PM_END_A;
        const int neighbour = a->system->scene->port[port].subsystem[other];
        pm_subsystem_couple(
            s, j,
            neighbour < 0 ? NULL
                          : pm_subsystem_values(a->subsystem[neighbour], a->position[port][other]));
    }
}

pm_status pm_monolithic_step(pm_monolithic *assembly) {
    pm_monolithic *a = assembly;
    const int rounds = a->count > 0 ? pm_subsystem_rounds(a->subsystem[0]) : 0;
    for (int round = 0; round < rounds; ++round) {
        for (int i = 0; i < a->count; ++i) {
            pm_subsystem_expose(a->subsystem[i]);
        }
        for (int i = 0; i < a->count; ++i) {
            pm_subsystem_bulk(a->subsystem[i]);
            couple_ports(a, i);
        }
        for (int i = 0; i < a->count; ++i) {
            pm_subsystem_advance(a->subsystem[i]);
        }
    }
    for (int i = 0; i < a->count; ++i) {
        PM_TRY(pm_subsystem_end_step(a->subsystem[i]));
    }
    ++a->sample->step;
    a->sample->time = pm_scene_time(a->system->scene, 0, a->sample->step);
    fill_sample(a);
    pm_step_controller_note(&a->pace, a->sample);
    set_pace(a);
    return PM_OK;
}

int pm_monolithic_substeps(const pm_monolithic *assembly) {
    return assembly->pace.substeps;
}

const pm_sample *pm_monolithic_sample(const pm_monolithic *assembly) {
    return assembly->sample;
}
