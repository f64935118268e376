// Groups subsystems and ports by their models, and lays out their arrays.
#include <string.h>

#include "base/linalg.h"
#include "sim/batch_parts.h"

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a batch of subsystems");
}

static int width_of(int count) {
    return count >= PM_BATCH_MOST_LANES ? PM_BATCH_MOST_LANES
                                        : (count + PM_LANES - 1) / PM_LANES * PM_LANES;
}

// --- groups ---

// Returns true if two ports can be evaluated by one graph.
static bool alike(const pm_system *system, int a, int b) {
    bool same = system->port_owner[a] == system->port_owner[b];
    for (int end = 0; end < 2 && same; ++end) {
        const pm_scene_port *pa = &system->scene->port[a], *pb = &system->scene->port[b];
        const int *ca = pa->component[end], *cb = pb->component[end];
        const size_t size = (size_t)pa->layout[end].nz * sizeof *ca;
        same =
            (ca == cb || memcmp(ca, cb, size) == 0) &&
            pm_system_end_has_entropy(system, a, end) == pm_system_end_has_entropy(system, b, end);
    }
    return same;
}

// The members of the groups while these are made.
typedef struct grouping {
    int ngroup;
    int *first; // the first member of each group
    int *count; // the number of members of each
    int *group; // [nsubsystem] of the subsystems whose models have this owner, plus one; 0: none
    int *id;    // all members of the first group, then those of the second one, ...
} grouping;

// Takes arrays for at most `count` members from the arena.
static bool new_grouping(grouping *g, pm_arena *arena, int count, int nowner) {
    const size_t n = (size_t)count;
    *g = (grouping){.first = pm_arena_array(arena, n, sizeof *g->first),
                    .count = pm_arena_array(arena, n, sizeof *g->count),
                    .group = pm_arena_array(arena, (size_t)nowner, sizeof *g->group)};
    return g->first != NULL && g->count != NULL && g->group != NULL;
}

// Numbers the groups of subsystems, and counts the members of each.
static void group_parts(pm_batch *b, grouping *g) {
    for (int i = 0; i < b->count; ++i) {
        const int id = b->id[i];
        int *group = &g->group[b->system->part_owner[id]];
        if (*group == 0) {
            g->first[g->ngroup] = id;
            *group = ++g->ngroup;
        }
        b->part_at[id] = (pm_batch_place){*group - 1, g->count[*group - 1]++};
    }
}

static void group_ports(pm_batch *b, grouping *g) {
    for (int i = 0; i < b->njoint; ++i) {
        int group = g->ngroup - 1;
        while (group >= 0 && !alike(b->system, g->first[group], b->joint[i])) {
            --group;
        }
        if (group < 0) {
            group = g->ngroup++;
            g->first[group] = b->joint[i];
        }
        b->port_at[b->joint[i]] = (pm_batch_place){group, g->count[group]++};
    }
}

// Lists the members of each group in the batch's arena: those of group 0, then those of group 1,
// ...
static pm_status list_members(pm_batch *b, int count, const int *member, const pm_batch_place *at,
                              grouping *g) {
    g->id = pm_arena_array(&b->arena, (size_t)count, sizeof *g->id);
    if (g->id == NULL) {
        return no_memory();
    }
    for (int i = 0; i < count; ++i) {
        int before = 0;
        for (int k = 0; k < at[member[i]].group; ++k) {
            before += g->count[k];
        }
        g->id[before + at[member[i]].lane] = member[i];
    }
    return PM_OK;
}

// Gives every ghost its places behind all parts.
static pm_status lay_out_ghosts(pm_batch *b) {
    const pm_scene *scene = b->system->scene;
    b->parts_size = b->size;
    b->parts_lanes = b->lanes;
    b->ghost_first = pm_arena_array(&b->arena, (size_t)b->nghost, sizeof *b->ghost_first);
    if (b->ghost_first == NULL) {
        return no_memory();
    }
    for (int i = 0; i < b->nremote; ++i) {
        const int id = scene->port[b->remote[i].port].subsystem[1 - b->remote[i].end];
        int *first = &b->ghost_first[b->part_at[id].lane];
        if (*first == 0) {
            *first = (int)b->size;
            b->size += scene->subsystem[id].layout.nz;
            b->lanes += 1;
        }
    }
    b->ghost_z = pm_arena_array(&b->arena, (size_t)(b->size - b->parts_size), sizeof *b->ghost_z);
    return b->ghost_z == NULL ? no_memory() : PM_OK;
}

static pm_status lay_out(pm_batch *b) {
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part *p = &b->part[i];
        p->first = b->size;
        p->first_lane = b->lanes;
        b->lanes += (int64_t)p->nblock * p->width;
        b->size += (int64_t)p->nblock * p->width * p->nz;
    }
    PM_TRY(lay_out_ghosts(b));
    const size_t size = (size_t)b->size, nstage = (size_t)b->integrator->nstage;
    if (b->size > INT32_MAX) {
        return pm_fail(PM_ECONFIG, "%lld numbers are too many for one process", (long long)b->size);
    }
    double *memory = pm_arena_array(&b->arena, (5 + nstage) * size, sizeof *memory);
    uint64_t *renewed =
        pm_arena_array(&b->arena, PM_SHOWN_COUNT * (size_t)b->lanes, sizeof *renewed);
    if (memory == NULL || renewed == NULL) {
        return no_memory();
    }
    for (int i = 0; i < 3; ++i) {
        b->state[i] = memory + (size_t)i * size;
        b->renewed[i] = renewed + i * b->lanes;
    }
    b->z = b->stage_z = b->safe_z = b->state[0];
    b->dE = memory + 3 * size;
    b->dS = b->dE + size;
    b->k = b->dS + size;
    return PM_OK;
}

static pm_status make_parts(pm_batch *b, grouping *g) {
    group_parts(b, g);
    b->npart = g->ngroup;
    b->part = pm_arena_array(&b->arena, (size_t)b->npart, sizeof *b->part);
    if (b->part == NULL) {
        return no_memory();
    }
    PM_TRY(list_members(b, b->count, b->id, b->part_at, g));
    const int *id = g->id;
    for (int i = 0; i < b->npart; ++i) {
        const int width = width_of(g->count[i]);
        b->part[i] = (pm_batch_part){.count = g->count[i],
                                     .width = width,
                                     .nblock = (g->count[i] + width - 1) / width,
                                     .nz = b->system->scene->subsystem[g->first[i]].layout.nz,
                                     .id = id};
        id += g->count[i];
    }
    return PM_OK;
}

pm_status pm_batch_open_parts(pm_batch *b) {
    const int n = b->system->scene->nsubsystem;
    pm_arena scratch = {0};
    grouping g;
    pm_status status;
    b->part_at = pm_arena_array(&b->arena, (size_t)n, sizeof *b->part_at);
    if (b->part_at == NULL || !new_grouping(&g, &scratch, b->count, n)) {
        status = no_memory();
        goto done;
    }
    for (int i = 0; i < n; ++i) {
        b->part_at[i] = (pm_batch_place){PM_BATCH_NOWHERE, PM_BATCH_NOWHERE};
    }
    PM_TRY_DONE(make_parts(b, &g));
    PM_TRY_DONE(pm_batch_find_remote(b));
    PM_TRY_DONE(lay_out(b));
    for (int i = 0; i < b->npart; ++i) {
        PM_TRY_DONE(pm_batch_part_open(&b->part[i], &b->arena, b->system));
        PM_TRY_DONE(pm_batch_substep_open(&b->part[i], &b->arena, b->system->scene));
    }
    pm_batch_open_remote(b);
done:
    pm_arena_free(&scratch);
    return status;
}

// Notes where the subsystem at one end of each port of a group is. Lanes without a port look at the
// last one.
static pm_status open_end(pm_batch *b, const pm_batch_port *p, pm_batch_end *end, int which) {
    const pm_scene *scene = b->system->scene;
    const pm_scene_port *port = &scene->port[p->id[0]];
    const int lanes = p->nblock * p->width;
    int *place = pm_arena_array(&b->arena, 3 * (size_t)lanes, sizeof *place);
    pm_lane_row *row = pm_arena_array(&b->arena, (size_t)lanes / PM_LANES, sizeof *row);
    if (place == NULL || row == NULL) {
        return no_memory();
    }
    end->ny = port->layout[which].nz;
    end->component = port->component[which];
    for (int c = 0; c < end->ny; ++c) {
        end->wanted |= (uint64_t)1 << (end->component[c] & 63);
    }
    for (int l = 0; l < lanes; ++l) {
        const int member = l < p->count ? l : p->count - 1;
        const pm_batch_address at =
            pm_batch_address_of(b, scene->port[p->id[member]].subsystem[which]);
        place[l] = at.first;
        place[lanes + l] = at.step;
        place[2 * lanes + l] = at.lane;
    }
    end->place = (pm_lane_places){row, place, place + lanes, place + 2 * (ptrdiff_t)lanes};
    pm_lanes_note_rows(lanes, &end->place, row);
    return PM_OK;
}

// --- the order of sums ---

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

static pm_batch_order order_of(const pm_batch_port *p, int block) {
    const int lane = block * p->width, left = p->count - lane;
    const int count = left < p->width ? left : p->width;
    const int *const subsystem[2] = {p->end[0].place.lane + lane, p->end[1].place.lane + lane};
    return follows(count, subsystem, 1)   ? PM_ORDER_A_FIRST
           : follows(count, subsystem, 0) ? PM_ORDER_B_FIRST
                                          : PM_ORDER_PORT_BY_PORT;
}

static pm_status open_order(pm_batch *b, pm_batch_port *p) {
    p->order = pm_arena_array(&b->arena, (size_t)p->nblock, sizeof *p->order);
    if (p->order == NULL) {
        return no_memory();
    }
    for (int block = 0; block < p->nblock; ++block) {
        p->order[block] = (unsigned char)order_of(p, block);
    }
    return PM_OK;
}

// Returns true if every subsystem has its ports in the order of the groups.
static bool is_ordered(const pm_batch *b) {
    const pm_scene *scene = b->system->scene;
    bool ordered = true;
    for (int i = 0; i < b->count; ++i) {
        const int *end_at = scene->end_at, last = scene->first_end[b->id[i] + 1] - 1;
        for (int k = scene->first_end[b->id[i]]; k < last && ordered; ++k) {
            ordered = b->port_at[end_at[k] / 2].group <= b->port_at[end_at[k + 1] / 2].group;
        }
    }
    return ordered;
}

// Lists the ports at the subsystems of the batch.
static pm_status list_joints(pm_batch *b) {
    const pm_scene *scene = b->system->scene;
    for (int pass = 0; pass < 2; ++pass) {
        b->njoint = 0;
        for (int i = 0; i < scene->nport; ++i) {
            const int *id = scene->port[i].subsystem;
            const bool here = b->part_at[id[0]].group != PM_BATCH_NOWHERE ||
                              b->part_at[id[1]].group != PM_BATCH_NOWHERE;
            if (here && pass == 1) {
                b->joint[b->njoint] = i;
            }
            b->njoint += here;
        }
        if (pass == 0) {
            b->joint = pm_arena_array(&b->arena, (size_t)b->njoint, sizeof *b->joint);
            if (b->joint == NULL) {
                return no_memory();
            }
        }
    }
    return PM_OK;
}

static pm_status open_port(pm_batch *b, pm_batch_port *p, int count, const int *id) {
    const int width = width_of(count);
    *p = (pm_batch_port){
        .count = count, .width = width, .nblock = (count + width - 1) / width, .id = id};
    for (int end = 0; end < 2; ++end) {
        p->entropy[end] = pm_system_end_has_entropy(b->system, id[0], end);
        PM_TRY(open_end(b, p, &p->end[end], end));
    }
    PM_TRY(open_order(b, p));
    return pm_batch_port_open(p, &b->arena, b->system);
}

static pm_status make_ports(pm_batch *b, grouping *g) {
    group_ports(b, g);
    b->nport = g->ngroup;
    b->port = pm_arena_array(&b->arena, (size_t)b->nport, sizeof *b->port);
    if (b->port == NULL) {
        return no_memory();
    }
    PM_TRY(list_members(b, b->njoint, b->joint, b->port_at, g));
    const int *id = g->id;
    for (int i = 0; i < b->nport; id += g->count[i++]) {
        PM_TRY(open_port(b, &b->port[i], g->count[i], id));
    }
    b->ordered = is_ordered(b);
    return PM_OK;
}

pm_status pm_batch_open_ports(pm_batch *b) {
    pm_arena scratch = {0};
    grouping g;
    PM_TRY(list_joints(b));
    b->port_at = pm_arena_array(&b->arena, (size_t)b->system->scene->nport, sizeof *b->port_at);
    const pm_status status = b->port_at == NULL || !new_grouping(&g, &scratch, b->njoint, 0)
                                 ? no_memory()
                                 : make_ports(b, &g);
    pm_arena_free(&scratch);
    return status;
}
