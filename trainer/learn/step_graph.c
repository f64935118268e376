// The step of sim/subsystem.c as graph expressions.
#include "learn/step_graph.h"

void pm_build_coenergies(pm_graph *g, const pm_system *system, pm_state_nodes *state) {
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
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

// Inserts the rate of the exposed components into a rate of the whole state; other entries are 0.
static pm_node place(pm_graph *g, const pm_scene_port *port, int end, pm_node rate, int nz) {
    pm_node sum = PM_NO_NODE;
    const pm_layout *layout = &port->layout[end];
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        const pm_node part = pm_slice(g, rate, group->first, group->size);
        sum = pm_add_or(g, sum, pm_place(g, part, port->component[end][group->first], nz));
    }
    return sum;
}

pm_node pm_build_boundary_input(pm_graph *g, const pm_system *system, pm_node boundary_input,
                                double fraction) {
    const int n = system->scene->nprescribed;
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

// Returns the values of a boundary input in the place of the state and co-energies of a subsystem.
static pm_state_nodes boundary_input_nodes(pm_graph *g,
                                           const pm_scene_boundary_input *boundary_input,
                                           pm_node prescribed) {
    const int nz = boundary_input->layout.nz;
    return (pm_state_nodes){
        .z = pm_slice(g, prescribed, boundary_input->first, nz),
        .dE = pm_slice(g, prescribed, boundary_input->first + nz, nz),
        .dS = boundary_input->entropy ? pm_slice(g, prescribed, boundary_input->first + 2 * nz, nz)
                                      : PM_NO_NODE,
        .response = PM_NO_NODE,
    };
}

void pm_build_port_nodes(pm_graph *g, const pm_system *system, int port,
                         const pm_state_nodes *state, pm_node prescribed, pm_port_nodes end[2]) {
    const pm_scene_port *scene = &system->scene->port[port];
    for (int i = 0; i < 2; ++i) {
        const pm_state_nodes s =
            scene->subsystem[i] >= 0
                ? state[scene->subsystem[i]]
                : boundary_input_nodes(g, &system->scene->boundary_input[scene->boundary_input[i]],
                                       prescribed);
        end[i] = (pm_port_nodes){expose(g, scene, i, s.z), expose(g, scene, i, s.dE),
                                 expose(g, scene, i, s.dS), expose(g, scene, i, s.response)};
    }
}

static void add_port(pm_graph *g, const pm_system *system, int port, pm_state_nodes *state,
                     pm_node prescribed, pm_node *last, pm_node *degeneracy) {
    const pm_scene_port *scene = &system->scene->port[port];
    const pm_port_model *model = system->port[port];
    pm_node next = PM_NO_NODE;
    for (int own = 0; own < 2; ++own) {
        const int id = scene->subsystem[own];
        if (id < 0) {
            continue;
        }
        pm_port_nodes end[2];
        pm_build_port_nodes(g, system, port, state, prescribed, end);
        const pm_node rate =
            pm_port_rate(g, model, (pm_end)own, end, last[port], &next, degeneracy);
        if (rate != PM_NO_NODE) {
            const int nz = system->scene->subsystem[id].layout.nz;
            state[id].zdot = pm_add_or(g, state[id].zdot, place(g, scene, own, rate, nz));
        }
    }
    last[port] = next;
}

void pm_build_rates(pm_graph *g, const pm_system *system, pm_state_nodes *state, pm_node prescribed,
                    pm_node *last, pm_node *degeneracy) {
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        pm_state_nodes *s = &state[i];
        s->zdot = pm_part_bulk(g, system->part[i], s->z, s->dE, s->dS, degeneracy);
    }
    for (int i = 0; i < system->scene->nport; ++i) {
        add_port(g, system, i, state, prescribed, last, degeneracy);
    }
}

// Returns x times the factor of the steps' length, where there are both.
static pm_node stretched(pm_graph *g, pm_node x, pm_node stretch) {
    return x == PM_NO_NODE || stretch == PM_NO_NODE ? x : pm_mul(g, x, stretch);
}

// Computes how much each co-energy rises per unit of a rate that lasts for h seconds.
static void build_responses(pm_graph *g, const pm_system *system, pm_state_nodes *state, double h,
                            const pm_step_work *work) {
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        pm_state_nodes *s = &state[i];
        pm_system_responding(system, i, work->responding);
        s->response = pm_part_response(g, system->part[i], s->dE, s->to, work->responding);
        s->response = s->response == PM_NO_NODE ? PM_NO_NODE : pm_scale(g, s->response, h);
        s->response = stretched(g, s->response, work->stretch);
    }
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

// Sets the states of all subsystems at one stage of the integrator.
static void place_stage(pm_graph *g, const pm_system *system, const pm_integrator *rk, double h,
                        int stage, const pm_node *z, const pm_step_work *work) {
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        pm_state_nodes *s = &work->state[i];
        s->to = combine(g, z[i], h, stage, rk->a[stage], work->k + i * rk->nstage);
        s->from = PM_NO_NODE;
        s->z = s->to;
        s->response = PM_NO_NODE;
        if (rk->discrete) {
            s->from = z[i];
            // A separate node, because the response is the derivative by the new state alone.
            s->to = pm_offset(g, s->to, 0);
            s->z = pm_scale(g, pm_add(g, s->from, s->to), 0.5);
        }
    }
}

void pm_build_step(pm_graph *g, const pm_system *system, const pm_integrator *rk, double h,
                   int substeps, pm_node *z, pm_node boundary_input, pm_node *degeneracy,
                   const pm_step_work *work) {
    const int count = system->scene->nsubsystem;
    for (int substep = 0; substep < substeps; ++substep) {
        for (int i = 0; i < system->scene->nport; ++i) {
            work->last[i] = PM_NO_NODE;
        }
        for (int stage = 0; stage < rk->nstage; ++stage) {
            place_stage(g, system, rk, h, stage, z, work);
            pm_build_coenergies(g, system, work->state);
            if (rk->discrete) {
                build_responses(g, system, work->state, h, work);
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
