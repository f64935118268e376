// Opens one subsystem and answers questions about it.
#include "sim/subsystem.h"

#include <stdlib.h>

#include "sim/step_controller.h"
#include "sim/subsystem_parts.h"

// --- building ---

static pm_status open_ports(pm_subsystem *s) {
    const pm_scene *scene = s->system->scene;
    const int first = scene->first_end[s->id], end = scene->first_end[s->id + 1];
    const size_t count = (size_t)(end - first);
    s->port = pm_arena_array(&s->arena, count, sizeof *s->port);
    s->flux = pm_arena_array(&s->arena, 2 * count, sizeof *s->flux);
    s->prescribed =
        pm_arena_array(&s->arena, 2 * (size_t)scene->nprescribed, sizeof *s->prescribed);
    if (s->port == NULL || s->flux == NULL || s->prescribed == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the ports of %s", s->scene->name);
    }
    for (int i = first; i < end; ++i) {
        PM_TRY(pm_port_instance_open(&s->port[s->nport++], &s->arena, s->system, s->integrator,
                                     scene->end_at[i] / 2, (pm_end)(scene->end_at[i] % 2)));
    }
    return PM_OK;
}

static pm_status open_state(pm_subsystem *s) {
    const size_t nz = (size_t)s->nz;
    double *memory =
        pm_arena_array(&s->arena, (6 + (size_t)s->integrator->nstage) * nz, sizeof *memory);
    s->size = pm_arena_array(&s->arena, PM_MAX_GROUPS, sizeof *s->size);
    if (memory == NULL || s->size == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the state of %s", s->scene->name);
    }
    s->z = memory;
    s->stage_z = memory + nz;
    s->safe_z = memory + 2 * nz;
    s->at_z = memory + 3 * nz;
    s->error = memory + 4 * nz;
    s->next = memory + 5 * nz;
    s->k = memory + 6 * nz;
    return PM_OK;
}

static pm_status open_all(pm_subsystem *s) {
    const pm_scene *scene = s->system->scene;
    s->integrator = scene->integrator;
    s->substeps = scene->substeps;
    s->h = scene->dt / scene->substeps;
    const pm_part *part = s->system->part[s->id];
    if (!s->integrator->discrete && part->spec.solid != NULL) {
        return pm_fail(PM_ECONFIG,
                       "%s: subsystem %s is a solid, which needs the integrator "
                       "discrete_gradient",
                       scene->integrator_at, s->scene->name);
    }
    if (s->integrator->discrete && !pm_part_is_discrete(part)) {
        return pm_fail(PM_ECONFIG,
                       "%s: integrator %s needs energies and entropies of the features x, |x|, "
                       "ln|x|, |x|^2, <x,y> and |min(x,0)| alone; subsystem %s has others",
                       scene->integrator_at, s->integrator->name, s->scene->name);
    }
    s->range = pm_training_range_of(part);
    if (s->integrator->multirate) {
        PM_TRY(
            pm_multirate_open(&s->multirate, &s->arena, s->nz, s->scene->substeps, s->integrator));
    } else if (s->scene->substeps > 1) {
        return pm_fail(PM_ECONFIG,
                       "%s: subsystem %s asks for substeps of its own: integrator %s has none, "
                       "multirate3 and multirate3_balanced have",
                       s->scene->substeps_at, s->scene->name, s->integrator->name);
    }
    PM_TRY(open_state(s));
    PM_TRY(pm_local_dynamics_open(&s->dynamics, &s->arena, s->system, s->id, s->integrator, s->h));
    PM_TRY(open_ports(s));
    pm_subsystem_set_state(s, s->scene->initial != NULL ? s->scene->initial : s->z);
    return PM_OK;
}

pm_status pm_subsystem_open(pm_subsystem **subsystem, const pm_system *system, int subsystem_id) {
    pm_subsystem *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a subsystem");
    }
    s->system = system;
    s->id = subsystem_id;
    s->scene = &system->scene->subsystem[subsystem_id];
    s->nz = s->scene->layout.nz;
    const pm_status status = open_all(s);
    if (status != PM_OK) {
        pm_subsystem_close(s);
        return status;
    }
    *subsystem = s;
    return PM_OK;
}

void pm_subsystem_close(pm_subsystem *subsystem) {
    if (subsystem != NULL) {
        for (int i = 0; i < subsystem->nport; ++i) {
            pm_port_instance_close(&subsystem->port[i]);
        }
        pm_local_dynamics_close(&subsystem->dynamics);
        pm_arena_free(&subsystem->arena);
        free(subsystem);
    }
}

// --- what it is and how it steps ---

int pm_subsystem_nport(const pm_subsystem *s) {
    return s->nport;
}

int pm_subsystem_port_id(const pm_subsystem *s, int port) {
    return s->port[port].port_id;
}

pm_end pm_subsystem_end(const pm_subsystem *s, int port) {
    return s->port[port].end;
}

bool pm_subsystem_has_boundary_input(const pm_subsystem *s, int port) {
    return s->port[port].boundary_input != NULL;
}

pm_status pm_subsystem_share(pm_subsystem *s, int port, pm_subsystem *peer, int peer_port) {
    return pm_port_instance_share(&s->port[port], &peer->port[peer_port], s->system, s->integrator);
}

void pm_subsystem_set_boundary_input(pm_subsystem *s, const pm_boundary_input *boundary_input) {
    s->boundary_input = boundary_input;
}

bool pm_subsystem_completes_step(const pm_subsystem *s) {
    return s->substep == s->substeps;
}

int pm_subsystem_most_rounds(const pm_subsystem *s) {
    const pm_scene *scene = s->system->scene;
    const int most = scene->tolerance > 0 ? PM_MOST_SUBSTEPS : scene->substeps;
    const pm_integrator *rk = s->integrator;
    return most * (rk->discrete ? rk->most_iterations : rk->nstage);
}

void pm_subsystem_set_substeps(pm_subsystem *s, int substeps) {
    s->substeps = substeps;
    s->h = s->system->scene->dt / substeps;
}

const double *pm_subsystem_state(const pm_subsystem *s) {
    return s->z;
}

const pm_port_values *pm_subsystem_values(const pm_subsystem *s, int port) {
    return &s->port[port].own.shown;
}
