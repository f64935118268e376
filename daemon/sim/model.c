// Groups subsystems and ports by their models, opens their graphs, and lays out their arrays.
#include <string.h>

#include "model/prediction.h"
#include "sim/engine.h"

// A group of fewer members has a width of 1: most lanes of a wider block would stay empty.
#define FEWEST_IN_LANES 8

static int width_of(int count) {
    return count < FEWEST_IN_LANES  ? 1
           : count >= PM_MOST_LANES ? PM_MOST_LANES
                                    : (count + PM_LANES - 1) / PM_LANES * PM_LANES;
}

// --- groups of subsystems ---

// Checks that the integrator can serve a subsystem.
static pm_status check_subsystem(const pm_model *m, int id) {
    const pm_scene *scene = m->system->scene;
    const pm_scene_subsystem *subsystem = &scene->physics.subsystem[id];
    const pm_part *part = m->system->part[id];
    if (!m->method->implicit && pm_part_kind_of(part) == PM_PART_SOLID) {
        return pm_fail(PM_ECONFIG,
                       "%s: subsystem %s is a solid, which needs the integrator "
                       "discrete_gradient",
                       scene->physics.integrator_at, subsystem->name);
    }
    if (m->method->implicit && !pm_part_is_discrete(part)) {
        return pm_fail(PM_ECONFIG,
                       "%s: integrator %s needs energies and entropies of the features x, |x|, "
                       "ln|x|, |x|^2, <x,y>, sin(x), cos(x) and |min(x,0)| alone; subsystem %s "
                       "has others",
                       scene->physics.integrator_at, m->integrator->name, subsystem->name);
    }
    return PM_OK;
}

// Returns `list`, or a longer copy of it if there is no room behind its `count` elements.
static void *room_for_one(pm_arena *arena, void *list, int count, size_t size) {
    const int least = 8; // room is always a power of two
    if (count != 0 && (count < least || (count & (count - 1)) != 0)) {
        return list;
    }
    void *longer = pm_arena_array(arena, (size_t)(count == 0 ? least : 2 * count), size);
    if (longer != NULL && count > 0) {
        memcpy(longer, list, (size_t)count * size);
    }
    return longer;
}

// Finds the group of every subsystem, and lists the members of each: those of group 0, then those
// of group 1, ...
static pm_status group_subsystems(pm_model *m, pm_arena *scratch) {
    const pm_physics *physics = &m->system->scene->physics;
    const size_t count = (size_t)m->count;
    int *of_owner = pm_arena_array(scratch, (size_t)physics->nsubsystem, sizeof *of_owner);
    int *filled = pm_arena_array(scratch, count, sizeof *filled);
    int *member = pm_arena_array(&m->arena, count, sizeof *member);
    m->subsystem_at =
        pm_arena_array(&m->arena, (size_t)physics->nsubsystem, sizeof *m->subsystem_at);
    PM_TRY(pm_arena_status(scratch, "groups of subsystems"));
    PM_TRY(pm_arena_status(&m->arena, "groups of subsystems"));
    for (int i = 0; i < physics->nsubsystem; ++i) {
        m->subsystem_at[i] = (pm_member){PM_NOWHERE, PM_NOWHERE};
    }
    for (int i = 0; i < m->count; ++i) {
        const int id = m->id[i];
        int *of = &of_owner[m->system->owner[id]]; // the owner's group, plus one; 0: none
        PM_TRY(check_subsystem(m, id));
        if (*of == 0) {
            const pm_kind *kind = pm_kind_of(m, id);
            m->group = room_for_one(&m->arena, m->group, m->ngroup, sizeof *m->group);
            PM_TRY(pm_arena_status(&m->arena, "groups of subsystems"));
            m->group[m->ngroup] = (pm_subsystem_group){
                .kind = kind, .part = m->system->part[id], .nz = physics->subsystem[id].layout.nz};
            *of = ++m->ngroup;
        }
        pm_subsystem_group *group = &m->group[*of - 1];
        m->subsystem_at[id] = (pm_member){*of - 1, group->count++};
        *of = m->method->implicit || group->kind->single ? 0 : *of;
        m->most_nz = group->nz > m->most_nz ? group->nz : m->most_nz;
    }
    for (int i = 0; i < m->ngroup; ++i) {
        m->group[i].id = member;
        member += m->group[i].count;
    }
    for (int i = 0; i < m->count; ++i) {
        const pm_member at = m->subsystem_at[m->id[i]];
        ((int *)m->group[at.group].id)[filled[at.group]++] = m->id[i];
    }
    return PM_OK;
}

static pm_status open_group(pm_model *m, pm_subsystem_group *group) {
    const pm_kind *kind = group->kind;
    int width = m->method->implicit || kind->single ? 1 : width_of(group->count);
    PM_TRY(kind->open(m, group, width));
    if (group->width == 0) { // the graphs cannot be run in lanes
        kind->close(group);
        PM_TRY(kind->open(m, group, 1));
    }
    group->range = pm_training_range_of(group->part);
    group->nblock = (group->count + group->width - 1) / group->width;
    group->first = m->size;
    group->first_lane = m->lanes;
    group->first_block = m->nblock;
    m->lanes += (int64_t)group->nblock * group->width;
    m->size += (int64_t)group->nblock * group->width * group->nz;
    m->nblock += group->nblock;
    m->needs_end_rates = m->needs_end_rates || kind->needs_end_rates;
    return PM_OK;
}

// --- ghosts and addresses ---

pm_address pm_model_address(const pm_model *m, int id) {
    const pm_member at = m->subsystem_at[id];
    if (at.group == PM_NOWHERE) {
        return m->subsystem_ghost[id];
    }
    const pm_subsystem_group *group = &m->group[at.group];
    const int64_t block =
        group->first + (int64_t)(at.lane / group->width) * group->nz * group->width;
    return (pm_address){(int)block + at.lane % group->width, group->width,
                        (int)group->first_lane + at.lane};
}

static void add_ghost(pm_model *m, pm_address *ghost, int nz) {
    if (ghost->step == 0) {
        *ghost = (pm_address){(int)m->size, 1, (int)m->lanes};
        m->size += nz;
        m->lanes += 1;
    }
}

// Lists the remote ends, and the ghosts of all that ports here join with other processes and with
// boundary inputs.
static pm_status open_ghosts(pm_model *m) {
    const pm_physics *physics = &m->system->scene->physics;
    m->own_size = m->size;
    m->own_lanes = m->lanes;
    int nend = 0;
    for (int i = 0; i < m->count; ++i) {
        const int nport = physics->first_end[m->id[i] + 1] - physics->first_end[m->id[i]];
        m->most_nport = nport > m->most_nport ? nport : m->most_nport;
        nend += nport;
    }
    m->subsystem_ghost =
        pm_arena_array(&m->arena, (size_t)physics->nsubsystem, sizeof *m->subsystem_ghost);
    m->input_ghost =
        pm_arena_array(&m->arena, (size_t)physics->nboundary_input, sizeof *m->input_ghost);
    PM_TRY(pm_arena_status(&m->arena, "%d ends of ports", nend));
    for (int i = 0; i < m->count; ++i) {
        for (int k = physics->first_end[m->id[i]]; k < physics->first_end[m->id[i] + 1]; ++k) {
            const int port_id = physics->end_at[k] / 2, end = physics->end_at[k] % 2;
            const pm_scene_port *port = &physics->port[port_id];
            const int other = port->subsystem[1 - end], input = port->boundary_input[1 - end];
            if (other < 0) {
                add_ghost(m, &m->input_ghost[input], physics->boundary_input[input].layout.nz);
            } else if (m->subsystem_at[other].group == PM_NOWHERE) {
                add_ghost(m, &m->subsystem_ghost[other], physics->subsystem[other].layout.nz);
                m->remote = room_for_one(&m->arena, m->remote, m->nremote, sizeof *m->remote);
                PM_TRY(pm_arena_status(&m->arena, "%d ends of ports", nend));
                m->remote[m->nremote++] = (pm_remote){{port_id, (pm_end)end},
                                                      pm_model_address(m, m->id[i]),
                                                      m->subsystem_ghost[other]};
            }
        }
    }
    return m->size <= INT32_MAX ? PM_OK
                                : pm_fail(PM_ECONFIG, "%lld numbers are too many for one process",
                                          (long long)m->size);
}

// --- groups of ports ---

static bool has_end(const pm_model *m, const pm_scene_port *port, int end) {
    return port->subsystem[end] >= 0 && m->subsystem_at[port->subsystem[end]].group != PM_NOWHERE;
}

// Returns true if two ports can be evaluated by one graph.
static bool alike(const pm_model *m, int a, int b) {
    const pm_system *system = m->system;
    const pm_scene_port *pa = &system->scene->physics.port[a],
                        *pb = &system->scene->physics.port[b];
    const int *owner = system->owner + system->scene->physics.nsubsystem;
    bool same = owner[a] == owner[b];
    for (int end = 0; end < 2 && same; ++end) {
        const int *ca = pa->component[end], *cb = pb->component[end];
        const size_t size = (size_t)pa->layout[end].nz * sizeof *ca;
        same =
            (pa->subsystem[end] < 0) == (pb->subsystem[end] < 0) &&
            (ca == cb || memcmp(ca, cb, size) == 0) &&
            pm_system_end_has_entropy(system, a, end) == pm_system_end_has_entropy(system, b, end);
    }
    return same;
}

// Puts a port into a group that computes these ends of it.
static pm_status add_port(pm_model *m, int id, bool a, bool b) {
    int group = m->nport_group - 1;
    while (group >= 0 && (m->method->implicit || m->port_group[group].end[0].computed != a ||
                          m->port_group[group].end[1].computed != b ||
                          !alike(m, m->port_group[group].id[0], id))) {
        --group;
    }
    if (group < 0) {
        m->port_group =
            room_for_one(&m->arena, m->port_group, m->nport_group, sizeof *m->port_group);
        PM_TRY(pm_arena_status(&m->arena, "groups of ports"));
        group = m->nport_group++;
        m->port_group[group].end[0].computed = a;
        m->port_group[group].end[1].computed = b;
        // `id` holds the first member alone until all members are listed.
        m->port_group[group].id = m->joint + m->njoint;
    }
    const int lane = m->port_group[group].count++;
    for (int end = 0; end < 2; ++end) {
        if (m->port_group[group].end[end].computed) {
            m->port_at[id][end] = (pm_member){group, lane};
        }
    }
    return PM_OK;
}

// Finds the groups of all ports at the subsystems here, and lists the members of each.
static pm_status group_ports(pm_model *m, pm_arena *scratch) {
    const pm_physics *physics = &m->system->scene->physics;
    size_t njoint = 0;
    for (int i = 0; i < physics->nport; ++i) {
        njoint += has_end(m, &physics->port[i], 0) || has_end(m, &physics->port[i], 1);
    }
    m->joint = pm_arena_array(&m->arena, njoint, sizeof *m->joint);
    m->port_at = pm_arena_array(&m->arena, (size_t)physics->nport, sizeof *m->port_at);
    int *member = pm_arena_array(&m->arena, 2 * njoint, sizeof *member);
    int *filled = pm_arena_array(scratch, 2 * njoint, sizeof *filled);
    PM_TRY(pm_arena_status(&m->arena, "groups of ports"));
    PM_TRY(pm_arena_status(scratch, "groups of ports"));
    for (int i = 0; i < physics->nport; ++i) {
        const bool a = has_end(m, &physics->port[i], 0), b = has_end(m, &physics->port[i], 1);
        m->port_at[i][0] = m->port_at[i][1] = (pm_member){PM_NOWHERE, PM_NOWHERE};
        if (!a && !b) {
            continue;
        }
        m->joint[m->njoint] = i;
        // One group computes both ends of a port with a boundary input, whose flux is booked here.
        // Each end has a group of its own if the law evaluates the ends separately. A process with
        // few ports computes its own end of a port to another process; with many ports, lanes of
        // both ends cost less than groups of their own.
        const bool outside = physics->port[i].subsystem[0] < 0 || physics->port[i].subsystem[1] < 0;
        const bool apart =
            m->system->port[i]->law->separate || (njoint < FEWEST_IN_LANES && !(a && b));
        if (outside || !apart) {
            PM_TRY(add_port(m, i, true, true));
        } else {
            if (a) {
                PM_TRY(add_port(m, i, true, false));
            }
            if (b) {
                PM_TRY(add_port(m, i, false, true));
            }
        }
        ++m->njoint;
    }
    for (int i = 0; i < m->nport_group; ++i) {
        m->port_group[i].id = member;
        member += m->port_group[i].count;
    }
    for (int i = 0; i < m->njoint; ++i) {
        const pm_member *at = m->port_at[m->joint[i]];
        for (int end = 0; end < 2; ++end) {
            if (at[end].group != PM_NOWHERE && (end == 0 || at[1].group != at[0].group)) {
                ((int *)m->port_group[at[end].group].id)[filled[at[end].group]++] = m->joint[i];
            }
        }
    }
    return PM_OK;
}

// Notes where the subsystem at one end of each port of a group is. Lanes without a port look at the
// last one.
static pm_status open_end(pm_model *m, pm_port_group *group, int which) {
    const pm_physics *physics = &m->system->scene->physics;
    const pm_scene_port *port = &physics->port[group->id[0]];
    const int lanes = group->nblock * group->width;
    pm_port_group_end *end = &group->end[which];
    int *place = pm_arena_array(&m->arena, 3 * (size_t)lanes, sizeof *place);
    pm_lane_row *row = pm_arena_array(&m->arena, (size_t)lanes / PM_LANES, sizeof *row);
    PM_TRY(pm_arena_status(&m->arena, "a group of %d ports", group->count));
    end->ny = port->layout[which].nz;
    end->component = port->component[which];
    for (int c = 0; c < end->ny; ++c) {
        end->wanted |= (uint64_t)1 << (end->component[c] & 63);
    }
    for (int l = 0; l < lanes; ++l) {
        const pm_scene_port *member =
            &physics->port[group->id[l < group->count ? l : group->count - 1]];
        const pm_address at = member->subsystem[which] >= 0
                                  ? pm_model_address(m, member->subsystem[which])
                                  : m->input_ghost[member->boundary_input[which]];
        place[l] = at.first;
        place[lanes + l] = at.step;
        place[2 * lanes + l] = at.lane;
    }
    end->place = (pm_lane_places){row, place, place + lanes, place + 2 * (ptrdiff_t)lanes};
    if (group->width > 1) {
        pm_lanes_note_rows(lanes, &end->place, row);
    }
    end->first_rate = m->rates;
    m->rates += (int64_t)lanes * end->ny;
    const pm_member at = has_end(m, port, which) ? m->subsystem_at[port->subsystem[which]]
                                                 : (pm_member){PM_NOWHERE, PM_NOWHERE};
    end->needs_end_rates =
        end->computed && at.group != PM_NOWHERE && m->group[at.group].kind->needs_end_rates;
    return PM_OK;
}

// Opens the graph of the law. group->law stays NULL if nothing acts. It also stays NULL, and
// *served becomes false, if the graph cannot be run in the lanes of the group.
static pm_status open_law(pm_model *m, pm_port_group *group, bool *served) {
    const pm_system *system = m->system;
    const int id = group->id[0];
    const pm_port_model *model = system->port[id];
    const bool implicit = m->method->implicit;
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    pm_node input[2][PM_SHOWN_COUNT], rate[2] = {PM_NO_NODE, PM_NO_NODE};
    pm_node law_e[2] = {PM_NO_NODE, PM_NO_NODE}, next = PM_NO_NODE, output[5];
    for (int end = 0; end < 2; ++end) {
        const int ny = group->end[end].ny;
        // A boundary input is prescribed: its co-energy does not respond to the rate.
        const bool responds = implicit && system->scene->physics.port[id].subsystem[end] >= 0;
        input[end][PM_SHOWN_Z] = pm_input(g, true, 1, ny);
        input[end][PM_SHOWN_DE] = pm_input(g, true, 1, ny);
        input[end][PM_SHOWN_DS] =
            pm_system_end_has_entropy(system, id, end) ? pm_input(g, true, 1, ny) : PM_NO_NODE;
        input[end][PM_SHOWN_RESPONSE] = responds ? pm_input(g, true, 1, ny) : PM_NO_NODE;
    }
    group->nboth = group->end[0].ny + group->end[1].ny;
    const pm_node last = implicit ? pm_input(g, true, 1, group->nboth) : PM_NO_NODE;
    int count = 0;
    for (int end = 0; end < 2; ++end) {
        pm_port_nodes ends[2];
        pm_node degeneracy = PM_NO_NODE;
        for (int i = 0; i < 2; ++i) {
            ends[i] = (pm_port_nodes){input[i][PM_SHOWN_Z], input[i][PM_SHOWN_DE],
                                      input[i][PM_SHOWN_DS], input[i][PM_SHOWN_RESPONSE]};
        }
        if (!group->end[end].computed) {
            continue;
        }
        rate[end] = pm_port_rate(g, model, (pm_end)end, ends, last, &next, &degeneracy);
        if (rate[end] != PM_NO_NODE) {
            rate[end] = output[count++] =
                pm_broadcast_to(g, rate[end], (pm_shape){true, 1, group->end[end].ny});
            if (ends[end].e != input[end][PM_SHOWN_DE]) {
                law_e[end] = output[count++] =
                    pm_broadcast_to(g, ends[end].e, (pm_shape){true, 1, group->end[end].ny});
            }
        }
    }
    if (next != PM_NO_NODE) {
        output[count++] = next;
    }
    pm_status status =
        count > 0 ? pm_program_open_lanes(&group->law, g, count, output, group->width) : PM_OK;
    status = status == PM_OK ? pm_compiler_add(m->compiler, group->law, g) : status;
    *served = count == 0 || group->law != NULL;
    for (int end = 0; end < 2 && group->law != NULL; ++end) {
        pm_port_group_end *e = &group->end[end];
        for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
            e->shown[i] = pm_program_input(group->law, input[end][i]);
            e->is_input[i] = e->shown[i] != NULL;
        }
        e->law_rate = rate[end] == PM_NO_NODE ? NULL : pm_program_value(group->law, rate[end]);
        e->law_e = law_e[end] == PM_NO_NODE ? NULL : pm_program_value(group->law, law_e[end]);
    }
    if (next != PM_NO_NODE && group->law != NULL) {
        group->next = pm_program_value(group->law, next);
        group->last = pm_program_value(group->law, last);
    }
    pm_graph_close(g);
    return status;
}

// Returns true if, at every subsystem at both kinds of ends of a block, no port at end `later`
// comes before a port at the other end. `subsystem` [2][count] are the places of the subsystems.
static bool follows(int count, const int *const subsystem[2], int later) {
    bool does = true;
    for (int i = 0; i < count && does; ++i) {
        for (int j = i; j < count && does; ++j) {
            does = subsystem[later][i] != subsystem[1 - later][j];
        }
    }
    return does;
}

static pm_status open_port_group(pm_model *m, pm_port_group *group) {
    const pm_scene_port *port = &m->system->scene->physics.port[group->id[0]];
    bool served = false;
    group->joins_gaps = m->system->port[group->id[0]]->law->joins_gaps;
    group->outside = port->subsystem[0] < 0 || port->subsystem[1] < 0;
    for (int end = 0; end < 2; ++end) {
        group->end[end].ny = port->layout[end].nz;
    }
    group->width = m->method->implicit ? 1 : width_of(group->count);
    PM_TRY(open_law(m, group, &served));
    if (!served) {
        group->width = 1;
        PM_TRY(open_law(m, group, &served));
    }
    group->nblock = (group->count + group->width - 1) / group->width;
    group->first_lane = m->port_lanes;
    group->first_block = m->nport_block;
    m->port_lanes += (int64_t)group->nblock * group->width;
    m->nport_block += group->nblock;
    group->order = pm_arena_array(&m->arena, (size_t)group->nblock, sizeof *group->order);
    for (int end = 0; end < 2; ++end) {
        PM_TRY(open_end(m, group, end));
        // The fluxes need the co-energies, also where the law does not depend on them.
        pm_port_group_end *e = &group->end[end];
        const bool needs[PM_SHOWN_COUNT] = {
            [PM_SHOWN_DE] = true,
            [PM_SHOWN_DS] = pm_system_end_has_entropy(m->system, group->id[0], end)};
        for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
            if (needs[i] && e->computed && e->shown[i] == NULL) {
                e->shown[i] = pm_arena_array(&m->arena, (size_t)e->ny * (size_t)group->width,
                                             sizeof *e->shown[i]);
            }
        }
    }
    PM_TRY(pm_arena_status(&m->arena, "a group of %d ports", group->count));
    group->inner = group->end[0].computed && group->end[1].computed;
    for (int i = 0; i < group->count && group->inner; ++i) {
        const pm_scene_port *member = &m->system->scene->physics.port[group->id[i]];
        group->inner = has_end(m, member, 0) && has_end(m, member, 1);
    }
    for (int block = 0; block < group->nblock; ++block) {
        const int lane = block * group->width, left = group->count - lane;
        const int count = left < group->width ? left : group->width;
        const int *const at[2] = {group->end[0].place.lane + lane, group->end[1].place.lane + lane};
        group->order[block] = (unsigned char)(follows(count, at, 1)   ? PM_ORDER_A_FIRST
                                              : follows(count, at, 0) ? PM_ORDER_B_FIRST
                                                                      : PM_ORDER_PORT_BY_PORT);
    }
    return PM_OK;
}

// --- data ---

// Returns the next array of a piece of memory, or NULL if it has no elements.
static void *take(char **memory, size_t count, size_t size) {
    void *array = *memory;
    *memory += count * size;
    return count == 0 ? NULL : array;
}

static pm_status open_data(const pm_model *m, pm_data *d, pm_arena *arena) {
    const pm_scene *scene = m->system->scene;
    const bool implicit = m->method->implicit;
    const size_t size = (size_t)m->size, lanes = (size_t)m->own_lanes;
    const size_t nstage = implicit ? 1 : (size_t)m->integrator->nstage;
    // These arrays lie in one piece of memory. Pieces of their own would begin at equal places of
    // pages, and their numbers of the same subsystem would drive each other out of the cache.
    const int nshown = implicit ? 4 : 2;
    double *memory = pm_arena_array(
        arena, (3 + (size_t)nshown + nstage + (m->needs_end_rates ? 1 : 0)) * size, sizeof *memory);
    const size_t nghost = size - (size_t)m->own_size, nremote = (size_t)m->nremote;
    const bool adaptive = pm_physics_is_adaptive(&scene->physics);
    uint64_t *changed;
    PM_TRY(pm_arena_status(arena, "the subsystems of a process"));
    for (int i = 0; i < 3; ++i, memory += size) {
        d->state[i] = memory;
    }
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        if (implicit || i == PM_SHOWN_DE || i == PM_SHOWN_DS) {
            d->shown[i] = memory;
            memory += size;
        }
    }
    d->k = memory;
    d->end_k = m->needs_end_rates ? memory + nstage * size : NULL;
    // The arrays that a step changes in place lie in one piece, so that one copy keeps them.
    const size_t nprojection = m->integrator->balanced ? lanes : 0, nerror = adaptive ? lanes : 0;
    d->before.size = PM_SHOWN_COUNT * (size_t)m->lanes * sizeof *changed +
                     (3 * lanes + (size_t)m->port_lanes) * sizeof(long) +
                     (nghost + (1 + PM_MAX_GROUPS) * nerror) * sizeof(double) +
                     nremote * sizeof *d->remote_flux + nprojection * sizeof *d->projection;
    char *now = d->before.now = pm_arena_alloc(arena, d->before.size);
    PM_TRY(pm_arena_status(arena, "the subsystems of a process"));
    changed = take(&now, PM_SHOWN_COUNT * (size_t)m->lanes, sizeof *changed);
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        d->changed[i] = changed + i * m->lanes;
    }
    d->rested = take(&now, lanes, sizeof *d->rested);
    d->more_exposures = take(&now, lanes, sizeof *d->more_exposures);
    d->out_of_range = take(&now, lanes, sizeof *d->out_of_range);
    d->port_rested = take(&now, (size_t)m->port_lanes, sizeof *d->port_rested);
    d->ghost_z = take(&now, nghost, sizeof *d->ghost_z);
    d->error = take(&now, nerror, sizeof *d->error);
    d->length = take(&now, PM_MAX_GROUPS * nerror, sizeof *d->length);
    d->remote_flux = take(&now, nremote, sizeof *d->remote_flux);
    d->projection = take(&now, nprojection, sizeof *d->projection);
    d->known = pm_arena_array(arena, (size_t)m->nblock, sizeof *d->known);
    d->E = pm_arena_array(arena, lanes, sizeof *d->E);
    d->S = pm_arena_array(arena, lanes, sizeof *d->S);
    d->bulk_rate = pm_arena_array(arena, (size_t)m->own_size, sizeof *d->bulk_rate);
    d->bulk_kept = pm_arena_array(arena, (size_t)m->nblock, sizeof *d->bulk_kept);
    if (m->integrator->balanced) {
        d->coupled =
            pm_arena_array(arena, (size_t)(3 * m->most_nz * PM_MOST_LANES), sizeof *d->coupled);
    }
    d->iteration = implicit ? pm_arena_array(arena, lanes, sizeof *d->iteration) : NULL;
    d->moves = implicit ? pm_arena_array(arena, lanes, sizeof *d->moves) : NULL;
    d->port_rate = pm_arena_array(arena, (size_t)m->rates, sizeof *d->port_rate);
    d->port_kept = pm_arena_array(arena, (size_t)m->nport_block, sizeof *d->port_kept);
    d->scratch = pm_arena_array(arena, 4 * (size_t)m->most_nz, sizeof *d->scratch);
    d->prescribed =
        pm_arena_array(arena, 2 * (size_t)scene->physics.nprescribed, sizeof *d->prescribed);
    d->books = pm_arena_array(arena, 2 * (size_t)m->most_nport, sizeof *d->books);
    PM_TRY(pm_lane_flux_new(&d->bulk, arena, (int)m->own_lanes));
    PM_TRY(pm_lane_flux_new(&d->flux[0], arena, (int)m->port_lanes));
    PM_TRY(pm_lane_flux_new(&d->flux[1], arena, (int)m->port_lanes));
    PM_TRY(pm_arena_status(arena, "the subsystems of a process"));
    d->z = d->stage_z = d->safe_z = d->state[0];
    d->substeps = scene->physics.substeps;
    d->h = scene->physics.dt / d->substeps;
    return PM_OK;
}

pm_status pm_model_open(pm_model *m, pm_data *d, const pm_system *system, int count,
                        const int *id) {
    pm_arena scratch = {0};
    pm_status status;
    m->system = system;
    m->count = count;
    m->id = id;
    m->integrator = system->scene->physics.integrator;
    m->method = pm_method_of(m->integrator);
    PM_TRY_DONE(
        pm_system_check_integrator(system, m->integrator, system->scene->physics.integrator_at));
    PM_TRY_DONE(group_subsystems(m, &scratch));
    PM_TRY_DONE(system->compiled ? pm_compiler_open(&m->compiler) : PM_OK);
    for (int i = 0; i < m->ngroup; ++i) {
        PM_TRY_DONE(open_group(m, &m->group[i]));
    }
    PM_TRY_DONE(open_ghosts(m));
    PM_TRY_DONE(group_ports(m, &scratch));
    for (int i = 0; i < m->nport_group; ++i) {
        PM_TRY_DONE(open_port_group(m, &m->port_group[i]));
    }
    PM_TRY_DONE(system->compiled ? pm_compiler_link(m->compiler) : PM_OK);
    m->ordered = true; // does every subsystem have its ports in the order of the groups?
    const pm_physics *physics = &system->scene->physics;
    for (int i = 0; i < count; ++i) {
        const int *end_at = physics->end_at, last = physics->first_end[id[i] + 1] - 1;
        for (int k = physics->first_end[id[i]]; k < last && m->ordered; ++k) {
            m->ordered = m->port_at[end_at[k] / 2][end_at[k] % 2].group <=
                         m->port_at[end_at[k + 1] / 2][end_at[k + 1] % 2].group;
        }
    }
    PM_TRY_DONE(open_data(m, d, &m->arena));
done:
    pm_compiler_close(m->compiler);
    m->compiler = NULL;
    pm_arena_free(&scratch);
    return status;
}

void pm_model_close(pm_model *m) {
    for (int i = 0; i < m->ngroup && m->group != NULL; ++i) {
        m->group[i].kind->close(&m->group[i]);
    }
    for (int i = 0; i < m->nport_group && m->port_group != NULL; ++i) {
        pm_program_close(m->port_group[i].law);
    }
    pm_arena_free(&m->arena);
}
