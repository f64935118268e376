// A small scene as one graph: what its parts show, their rates with those of all ports, and the
// terms of the books, at one stage. A round of the engine then takes one run of a program instead
// of three or more for each group. The bits and the counts are those of the groups' own programs:
// what would have rested is counted, and after a step in which something rested the groups go on by
// themselves, since resting costs less. Only compiled code is worth it: instructions for the single
// numbers of the books cost more than their loops.
#include <string.h>

#include "sim/engine.h"
#include "sim/step_graph.h"

// A scene of more subsystems and ports is not fused: programs grow, and groups have lanes.
#define MOST_COMPONENTS 32

// Four numbers that a round adds to a flux, or two without entropy.
typedef struct pm_fused_books {
    int of; // 0: the bulk term, 1 and 2: the ends of a port
    int lane;
    bool entropy;
} pm_fused_books;

struct pm_fused {
    pm_program *program;
    double *z, *u, *weight; // [own_size], [nprescribed], [1]; inputs, NULL: not needed
    const double *k, *shown[PM_SHOWN_COUNT], *books; // k, dE and dS [own_size]
    int nbooks;
    pm_fused_books *add; // [nbooks]
    bool prescribes;     // some law depends on boundary inputs
    bool serves;         // in the present step
    long rested;         // what has rested in the present step
    double *next;        // [own_size] work space
};

// --- opening ---

// Work space while the graph is built.
typedef struct building {
    pm_graph *g;
    pm_fused *f;
    pm_node weight, books;
} building;

// Adds the sums of w e.rate and w eta.rate, and those of the magnitudes of their terms.
static void add_books(building *b, int of, int lane, pm_node e, pm_node eta, pm_node rate) {
    const pm_node co[] = {e, eta};
    const pm_shape one = {true, 1, 1};
    for (int i = 0; i < 2 && rate != PM_NO_NODE; ++i) {
        if (co[i] != PM_NO_NODE) {
            const pm_node term = pm_mul(b->g, b->weight, pm_mul(b->g, co[i], rate));
            const pm_node sum = pm_sum_to(b->g, term, one);
            const pm_node gross = pm_sum_to(b->g, pm_magnitude(b->g, term), one);
            b->books = pm_concat_or(b->g, b->books, pm_concat(b->g, 2, (pm_node[]){sum, gross}));
        }
    }
    if (rate != PM_NO_NODE) {
        b->f->add[b->f->nbooks++] = (pm_fused_books){of, lane, eta != PM_NO_NODE};
    }
}

// Adds the rate of the components that an end of a port exposes to the rate of a subsystem.
static pm_node add_rate(pm_graph *g, const pm_scene_port *port, int end, int nz, pm_node rate,
                        pm_node sum) {
    const pm_layout *layout = &port->layout[end];
    pm_node all = PM_NO_NODE;
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        const pm_node part = pm_slice(g, rate, group->first, group->size);
        all = pm_add_or(g, all, pm_place(g, part, port->component[end][group->first], nz));
    }
    return pm_add_or(g, sum, all);
}

static void build_ports(const pm_model *m, building *b, pm_state_nodes *state, pm_node u) {
    const pm_physics *physics = &m->system->scene->physics;
    for (int i = 0; i < physics->nport; ++i) {
        const pm_scene_port *port = &physics->port[i];
        for (int end = 0; end < 2; ++end) {
            pm_port_nodes ends[2];
            pm_node next = PM_NO_NODE, degeneracy = PM_NO_NODE;
            const pm_port_group *group = &m->port_group[m->port_at[i][end].group];
            const int lane = (int)group->first_lane + m->port_at[i][end].lane;
            const int id = port->subsystem[end];
            pm_build_port_nodes(b->g, m->system, i, state, u, ends);
            const pm_node rate = pm_port_rate(b->g, m->system->port[i], (pm_end)end, ends,
                                              PM_NO_NODE, &next, &degeneracy);
            add_books(b, 1 + end, lane, ends[end].e, ends[end].eta, rate);
            if (id >= 0 && rate != PM_NO_NODE) {
                state[id].zdot = add_rate(b->g, port, end, physics->subsystem[id].layout.nz, rate,
                                          state[id].zdot);
            }
        }
        b->f->prescribes = b->f->prescribes || port->subsystem[0] < 0 || port->subsystem[1] < 0;
    }
}

static bool is_eligible(const pm_model *m) {
    const pm_physics *physics = &m->system->scene->physics;
    bool eligible = m->compiler != NULL && m->count == physics->nsubsystem && m->nremote == 0 &&
                    !m->method->implicit && !m->integrator->balanced &&
                    !pm_physics_is_adaptive(physics) && !m->needs_end_rates &&
                    physics->nsubsystem + physics->nport <= MOST_COMPONENTS;
    for (int i = 0; i < m->ngroup && eligible; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        eligible = group->width == 1 && group->object == NULL &&
                   group->shown[PM_SHOWN_DE] != NULL && pm_part_has_energy(group->part);
    }
    for (int i = 0; i < m->nport_group && eligible; ++i) {
        eligible = m->port_group[i].width == 1;
    }
    return eligible;
}

static pm_status build(pm_model *m, pm_fused *f, pm_arena *scratch, building *b) {
    const pm_physics *physics = &m->system->scene->physics;
    const size_t count = (size_t)physics->nsubsystem;
    pm_state_nodes *state = pm_arena_array(scratch, count, sizeof *state);
    pm_node *part[3]; // of k, dE and dS in the order of the engine
    for (int i = 0; i < 3; ++i) {
        part[i] = pm_arena_array(scratch, count, sizeof *part[i]);
    }
    f->add = pm_arena_array(&m->arena, count + 2 * (size_t)physics->nport, sizeof *f->add);
    f->next = pm_arena_array(&m->arena, (size_t)m->own_size, sizeof *f->next);
    PM_TRY(pm_arena_status(scratch, "a fused scene"));
    PM_TRY(pm_arena_status(&m->arena, "a fused scene"));
    pm_graph *g = b->g;
    const pm_node z = pm_input(g, true, 1, (int)m->own_size);
    const pm_node u =
        physics->nprescribed > 0 ? pm_input(g, true, 1, physics->nprescribed) : PM_NO_NODE;
    b->weight = pm_input(g, true, 1, 1);
    for (int i = 0; i < physics->nsubsystem; ++i) {
        pm_state_nodes *s = &state[i];
        s->z = s->to =
            pm_slice(g, z, pm_model_address(m, i).first, physics->subsystem[i].layout.nz);
        s->from = s->response = PM_NO_NODE;
    }
    pm_build_coenergies(g, m->system, state);
    for (int i = 0; i < physics->nsubsystem; ++i) {
        pm_state_nodes *s = &state[i];
        pm_node degeneracy = PM_NO_NODE;
        s->zdot = pm_part_bulk(g, m->system->part[i], s->z, s->dE, s->dS, &degeneracy);
        if (s->zdot != PM_NO_NODE) {
            s->zdot =
                pm_broadcast_to(g, s->zdot, (pm_shape){true, 1, physics->subsystem[i].layout.nz});
        }
        add_books(b, 0, pm_model_address(m, i).lane, s->dE, s->dS, s->zdot);
    }
    build_ports(m, b, state, u);
    int n = 0;
    for (int i = 0; i < m->ngroup; ++i) {
        for (int k = 0; k < m->group[i].count; ++k, ++n) {
            const int id = m->group[i].id[k], nz = m->group[i].nz;
            const pm_node rate =
                pm_part_release(g, m->system->part[id], state[id].z, state[id].zdot);
            const pm_node result[] = {rate, state[id].dE, state[id].dS};
            for (int j = 0; j < 3; ++j) {
                const pm_node x = result[j] == PM_NO_NODE ? pm_constant(g, 0, 1, nz) : result[j];
                part[j][n] = pm_broadcast_to(g, x, (pm_shape){true, 1, nz});
            }
        }
    }
    pm_node output[4];
    for (int j = 0; j < 3; ++j) {
        output[j] = pm_concat(g, n, part[j]);
    }
    output[3] = b->books;
    PM_TRY(pm_program_open(&f->program, g, b->books == PM_NO_NODE ? 3 : 4, output, 1));
    f->z = pm_program_input(f->program, z);
    f->u = pm_program_input(f->program, u);
    f->weight = pm_program_input(f->program, b->weight);
    f->k = pm_program_value(f->program, output[0]);
    f->shown[PM_SHOWN_DE] = pm_program_value(f->program, output[1]);
    f->shown[PM_SHOWN_DS] = pm_program_value(f->program, output[2]);
    f->books = b->books == PM_NO_NODE ? NULL : pm_program_value(f->program, b->books);
    return pm_compiler_add(m->compiler, f->program, g);
}

pm_status pm_fused_open(pm_model *m) {
    pm_arena scratch = {0};
    if (!is_eligible(m)) {
        return PM_OK;
    }
    m->fused = pm_arena_alloc(&m->arena, sizeof *m->fused);
    PM_TRY(pm_arena_status(&m->arena, "a fused scene"));
    building b = {.f = m->fused, .books = PM_NO_NODE};
    pm_status status = pm_graph_open(&b.g);
    if (status == PM_OK) {
        status = build(m, m->fused, &scratch, &b);
    }
    pm_graph_close(b.g);
    pm_arena_free(&scratch);
    return status;
}

void pm_fused_close(pm_model *m) {
    if (m->fused != NULL) {
        pm_program_close(m->fused->program);
    }
}

void pm_fused_prepare(const pm_model *m) {
    if (m->fused != NULL) {
        m->fused->rested = 0;
        pm_program_prepare(m->fused->program);
    }
}

// --- a round ---

bool pm_fused_serves(const pm_model *m, const pm_data *d) {
    if (m->fused != NULL && pm_is_first_round(d)) {
        m->fused->serves = m->fused->rested == 0 && pm_program_is_compiled(m->fused->program);
        m->fused->rested = 0;
    }
    return m->fused != NULL && m->fused->serves;
}

// Notes in `changed` which of the numbers [own_size] differ, and replaces them.
static void renew(const pm_model *m, const double *now, double *before, uint64_t *changed) {
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        for (int block = 0; block < group->nblock; ++block) {
            const int64_t at = group->first + (int64_t)block * group->nz;
            pm_lanes_renew(group->nz, 1, now + at, before + at,
                           changed + group->first_lane + block);
        }
    }
}

// Counts what the groups would not have evaluated.
static void count_resting(const pm_model *m, pm_data *d) {
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        for (int64_t l = group->first_lane; l < group->first_lane + group->count; ++l) {
            uint64_t changed = 0;
            for (int s = 0; s < PM_SHOWN_COUNT; ++s) {
                changed |= group->bulk_input[s] != NULL ? d->changed[s][l] : 0;
            }
            const bool rests = group->bulk != NULL && changed == 0;
            d->rested[l] += rests;
            m->fused->rested += rests;
        }
    }
    for (int i = 0; i < m->nport_group; ++i) {
        const pm_port_group *group = &m->port_group[i];
        for (int l = 0; l < group->count; ++l) {
            uint64_t changed = 0;
            for (int e = 0; e < 2; ++e) {
                const pm_port_group_end *end = &group->end[e];
                for (int s = 0; s < PM_SHOWN_COUNT; ++s) {
                    changed |=
                        end->is_input[s] ? d->changed[s][end->place.lane[l]] & end->wanted : 0;
                }
            }
            d->port_rested[group->first_lane + l] += changed == 0;
            m->fused->rested += changed == 0 && group->law != NULL;
        }
    }
}

static void book(const pm_fused *f, pm_data *d, bool first) {
    pm_lane_flux *const fluxes[] = {&d->bulk, &d->flux[0], &d->flux[1]};
    const double *x = f->books;
    for (int i = 0; i < f->nbooks; ++i) {
        const pm_fused_books *b = &f->add[i];
        const pm_lane_flux flux = pm_lane_flux_from(fluxes[b->of], b->lane);
        double *const to[] = {flux.energy, flux.energy_gross, flux.entropy, flux.entropy_gross};
        for (int k = 0; k < (b->entropy ? 4 : 2); ++k) {
            *to[k] = (first ? 0 : *to[k]) + *x++;
        }
    }
}

void pm_fused_rates(const pm_model *m, pm_data *d, double weight) {
    pm_fused *f = m->fused;
    const size_t size = (size_t)m->own_size * sizeof(double);
    const bool first = pm_is_first_round(d);
    if (f->prescribes) {
        pm_prescribe(m, d, pm_integrator_time(m->integrator, d->stage));
    }
    if (f->u != NULL) {
        memcpy(f->u, d->prescribed,
               (size_t)m->system->scene->physics.nprescribed * sizeof *d->prescribed);
    }
    if (f->z != NULL) {
        memcpy(f->z, d->stage_z, size);
    }
    if (f->weight != NULL) {
        *f->weight = weight;
    }
    pm_program_run_prepared(f->program, 1);
    memcpy(pm_stage_rates(m, d), f->k, size);
    if (!first) { // in the first round the groups have shown themselves
        for (int s = PM_SHOWN_DE; s <= PM_SHOWN_DS; ++s) {
            renew(m, f->shown[s], d->shown[s], d->changed[s]);
        }
    }
    count_resting(m, d);
    if (first || weight != 0) {
        book(f, d, first);
    }
    ++d->bulk_calls;
    ++d->port_calls;
}

void pm_fused_refresh(const pm_model *m, pm_data *d) {
    for (int i = 0; i < m->ngroup; ++i) {
        const pm_subsystem_group *group = &m->group[i];
        for (int block = 0; block < group->nblock; ++block) {
            const int64_t lane = group->first_lane + block;
            m->fused->rested += d->changed[PM_SHOWN_Z][lane] == 0;
            if (d->changed[PM_SHOWN_Z][lane] == 0) {
                memcpy(group->z, d->stage_z + group->first + (ptrdiff_t)block * group->nz,
                       (size_t)group->nz * sizeof *group->z);
                pm_program_run_prepared(group->exposure, 1);
                d->E[lane] = group->E[0];
                d->S[lane] = group->S == NULL ? d->S[lane] : group->S[0];
            }
        }
    }
    memset(d->bulk_kept, 0, (size_t)m->nblock * sizeof *d->bulk_kept);
    if (m->nport_block > 0) {
        memset(d->port_kept, 0, (size_t)m->nport_block * sizeof *d->port_kept);
    }
}

void pm_fused_advance(const pm_model *m, pm_data *d) {
    pm_fused *f = m->fused;
    const pm_integrator *rk = m->integrator;
    const bool last = d->stage + 1 == rk->nstage;
    const int count = last ? rk->nstage : d->stage + 1;
    const double *weight = last ? rk->b : rk->a[d->stage + 1], *before = d->stage_z;
    const int size = (int)m->own_size;
    memset(f->next, 0, (size_t)size * sizeof *f->next);
    for (int i = 0; i < count; ++i) {
        const double *k = d->k + i * m->size;
        for (int c = 0; c < size; ++c) {
            f->next[c] += weight[i] * k[c];
        }
    }
    for (int c = 0; c < size; ++c) {
        f->next[c] = d->z[c] + d->h * f->next[c];
    }
    d->stage_z = pm_next_stage(d);
    if (before != d->stage_z) {
        memcpy(d->stage_z, before, (size_t)size * sizeof *before);
    }
    renew(m, f->next, d->stage_z, d->changed[PM_SHOWN_Z]);
    d->shown[PM_SHOWN_Z] = d->stage_z;
    for (int64_t l = 0; l < m->own_lanes; ++l) {
        const bool rests = d->changed[PM_SHOWN_Z][l] == 0;
        d->rested[l] += rests;
        f->rested += rests;
    }
    ++d->exposure_calls;
    pm_rest_ghosts(m, d);
    d->stage = last ? 0 : d->stage + 1;
    d->substep += last;
    d->z = last ? d->stage_z : d->z;
}
