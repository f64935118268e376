// The step of sim/step.c as graph expressions.
#include "sim/step_graph.h"

void pm_build_coenergies(pm_graph *g, const pm_system *system, pm_state_nodes *state) {
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        pm_state_nodes *s = &state[i];
        pm_part_coenergies(g, system->part[i], s->from, s->to, &s->dE, &s->dS);
    }
}

// Selects the components of a state or co-vector that an end of a port exposes.
static pm_node expose(pm_graph *g, const pm_scene_port *port, int end, pm_node vector) {
    if (vector == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    pm_node part[PM_MAX_GROUPS];
    const pm_layout *layout = &port->layout[end];
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        part[i] = pm_slice(g, vector, port->component[end][group->first], group->size);
    }
    return pm_concat(g, layout->ngroup, part);
}

pm_node pm_build_boundary_input(pm_graph *g, const pm_system *system, pm_node boundary_input,
                                double fraction) {
    const int n = system->scene->physics.nprescribed;
    if (boundary_input == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    int order = fraction == 0 ? 0 : PM_BOUNDARY_INPUT_ORDER - 1;
    pm_node value = pm_slice(g, boundary_input, order * n, n);
    while (--order >= 0) {
        value = pm_add(g, pm_scale(g, value, fraction), pm_slice(g, boundary_input, order * n, n));
    }
    return value;
}

// The nodes of a boundary input, which takes the place of the state and co-energies of a subsystem.
static pm_state_nodes input_nodes(pm_graph *g, const pm_scene_boundary_input *input,
                                  pm_node prescribed) {
    const int nz = input->layout.nz;
    return (pm_state_nodes){
        .z = pm_slice(g, prescribed, input->first, nz),
        .dE = pm_slice(g, prescribed, input->first + nz, nz),
        .dS = input->entropy ? pm_slice(g, prescribed, input->first + 2 * nz, nz) : PM_NO_NODE,
        .response = PM_NO_NODE,
    };
}

void pm_build_port_nodes(pm_graph *g, const pm_system *system, int port,
                         const pm_state_nodes *state, pm_node prescribed, pm_port_nodes end[2]) {
    const pm_physics *physics = &system->scene->physics;
    const pm_scene_port *scene = &physics->port[port];
    for (int i = 0; i < 2; ++i) {
        const pm_state_nodes s =
            scene->subsystem[i] >= 0
                ? state[scene->subsystem[i]]
                : input_nodes(g, &physics->boundary_input[scene->boundary_input[i]], prescribed);
        end[i] = (pm_port_nodes){expose(g, scene, i, s.z), expose(g, scene, i, s.dE),
                                 expose(g, scene, i, s.dS), expose(g, scene, i, s.response)};
    }
}

void pm_build_rates(pm_graph *g, const pm_system *system, pm_state_nodes *state, pm_node prescribed,
                    pm_node *last, pm_node *degeneracy) {
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        pm_state_nodes *s = &state[i];
        s->zdot = pm_part_bulk(g, system->part[i], s->z, s->dE, s->dS, degeneracy);
    }
    for (int i = 0; i < system->scene->physics.nport; ++i) {
        const pm_scene_port *scene = &system->scene->physics.port[i];
        const pm_port_model *model = system->port[i];
        pm_node next = PM_NO_NODE;
        for (int own = 0; own < 2; ++own) {
            const int id = scene->subsystem[own];
            if (id < 0) {
                continue;
            }
            pm_port_nodes end[2];
            pm_build_port_nodes(g, system, i, state, prescribed, end);
            const pm_node rate =
                pm_port_rate(g, model, (pm_end)own, end, last[i], &next, degeneracy);
            if (rate != PM_NO_NODE) {
                const int nz = system->scene->physics.subsystem[id].layout.nz;
                // Inserts the rate of the exposed components into a rate of the whole state; other
                // entries are 0.
                pm_node sum = PM_NO_NODE;
                const pm_layout *layout = &scene->layout[own];
                for (int k = 0; k < layout->ngroup; ++k) {
                    const pm_group *group = &layout->group[k];
                    const pm_node part = pm_slice(g, rate, group->first, group->size);
                    sum = pm_add_or(g, sum,
                                    pm_place(g, part, scene->component[own][group->first], nz));
                }
                state[id].zdot = pm_add_or(g, state[id].zdot, sum);
            }
        }
        last[i] = next;
    }
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        state[i].zdot = pm_part_release(g, system->part[i], state[i].z, state[i].zdot);
    }
}

pm_status pm_build_scene_rates(pm_graph *g, const pm_system *system, pm_node z, pm_node prescribed,
                               pm_arena *scratch, pm_node *k) {
    const pm_physics *physics = &system->scene->physics;
    const size_t n = (size_t)physics->nsubsystem;
    pm_state_nodes *state = pm_arena_array(scratch, n, sizeof *state);
    pm_node *last = pm_arena_array(scratch, (size_t)physics->nport + 1, sizeof *last);
    pm_node *part = pm_arena_array(scratch, n, sizeof *part);
    pm_node degeneracy = PM_NO_NODE;
    PM_TRY(pm_arena_status(scratch, "the rates of a scene"));
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &physics->subsystem[i];
        state[i].z = state[i].to = pm_slice(g, z, s->first, s->layout.nz);
        state[i].from = state[i].response = PM_NO_NODE;
    }
    for (int i = 0; i < physics->nport; ++i) {
        last[i] = PM_NO_NODE;
    }
    pm_build_coenergies(g, system, state);
    pm_build_rates(g, system, state, prescribed, last, &degeneracy);
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const int nz = physics->subsystem[i].layout.nz;
        const pm_node rate = state[i].zdot;
        part[i] = rate == PM_NO_NODE ? pm_constant(g, 0, 1, nz) : rate;
        part[i] = pm_broadcast_to(g, part[i], (pm_shape){true, 1, nz});
    }
    *k = pm_concat(g, physics->nsubsystem, part);
    return PM_OK;
}

// Returns x times the factor of the steps' length, where there are both.
static pm_node stretched(pm_graph *g, pm_node x, pm_node stretch) {
    return x == PM_NO_NODE || stretch == PM_NO_NODE ? x : pm_mul(g, x, stretch);
}

// Computes z + h sum_i weight_i k_i over n stages, without terms of weight zero.
static pm_node combine(pm_graph *g, pm_node z, double h, int n, const double *weight,
                       const pm_node *k) {
    pm_node sum = PM_NO_NODE;
    for (int i = 0; i < n; ++i) {
        if (weight[i] != 0 && k[i] != PM_NO_NODE) {
            sum = pm_add_or(g, sum, pm_scale(g, k[i], h * weight[i]));
        }
    }
    return pm_add_or(g, z, sum);
}

pm_step_work pm_step_work_new(const pm_system *system, pm_arena *arena) {
    const size_t count = (size_t)system->scene->physics.nsubsystem;
    pm_step_work w = {.stretch = PM_NO_NODE};
    w.state = pm_arena_array(arena, count, sizeof *w.state);
    w.k = pm_arena_array(arena, count * PM_MAX_STAGES, sizeof *w.k);
    w.last = pm_arena_array(arena, (size_t)system->scene->physics.nport + 1, sizeof *w.last);
    w.responding = pm_arena_array(arena, (size_t)system->scene->physics.nz, sizeof *w.responding);
    return w;
}

void pm_build_step(pm_graph *g, const pm_system *system, const pm_integrator *rk, double h,
                   int substeps, pm_node *z, pm_node boundary_input, pm_node *degeneracy,
                   const pm_step_work *work) {
    const int count = system->scene->physics.nsubsystem;
    for (int substep = 0; substep < substeps; ++substep) {
        for (int i = 0; i < system->scene->physics.nport; ++i) {
            work->last[i] = PM_NO_NODE;
        }
        for (int stage = 0; stage < rk->nstage; ++stage) {
            // The states at this stage.
            for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
                pm_state_nodes *s = &work->state[i];
                s->to = combine(g, z[i], h, stage, rk->a[stage], work->k + i * rk->nstage);
                s->from = PM_NO_NODE;
                s->z = s->to;
                s->response = PM_NO_NODE;
                if (pm_integrator_iterates(rk)) {
                    s->from = z[i];
                    // A separate node, because the response is the derivative by the new state
                    // alone.
                    s->to = pm_offset(g, s->to, 0);
                    s->z = pm_scale(g, pm_add(g, s->from, s->to), 0.5);
                }
            }
            pm_build_coenergies(g, system, work->state);
            if (pm_integrator_iterates(rk)) {
                // Computes how much each co-energy rises per unit of a rate that lasts for h
                // seconds.
                for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
                    pm_state_nodes *s = &work->state[i];
                    pm_system_responding(system, i, work->responding);
                    s->response =
                        pm_part_response(g, system->part[i], s->dE, s->to, work->responding);
                    s->response =
                        s->response == PM_NO_NODE ? PM_NO_NODE : pm_scale(g, s->response, h);
                    s->response = stretched(g, s->response, work->stretch);
                }
            }
            const double fraction = (substep + pm_integrator_time(rk, stage)) / substeps;
            pm_node later = PM_NO_NODE; // residuals of later stages are left out
            pm_build_rates(g, system, work->state,
                           pm_build_boundary_input(g, system, boundary_input, fraction), work->last,
                           substep == 0 && stage == 0 ? degeneracy : &later);
            for (int i = 0; i < count; ++i) {
                work->k[i * rk->nstage + stage] = stretched(g, work->state[i].zdot, work->stretch);
            }
        }
        for (int i = 0; i < count; ++i) {
            z[i] = combine(g, z[i], h, rk->nstage, rk->b, work->k + i * rk->nstage);
        }
    }
}
