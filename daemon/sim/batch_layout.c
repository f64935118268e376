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

// Numbers the groups of subsystems, and counts the members of each. `first` [nsubsystem] receives
// the first member of each group.
static int group_parts(pm_batch *b, int *first, int *count) {
    const pm_scene *scene = b->system->scene;
    int n = 0;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const int owner = b->system->part_owner[i];
        const int group = owner == i ? n++ : b->part_at[owner].group;
        first[group] = owner;
        b->part_at[i] = (pm_batch_place){group, count[group]++};
    }
    return n;
}

static int group_ports(pm_batch *b, int *first, int *count) {
    int n = 0;
    for (int i = 0; i < b->system->scene->nport; ++i) {
        int group = n - 1;
        while (group >= 0 && !alike(b->system, first[group], i)) {
            --group;
        }
        if (group < 0) {
            group = n++;
            first[group] = i;
        }
        b->port_at[i] = (pm_batch_place){group, count[group]++};
    }
    return n;
}

// Lists the members of each group: id [places] holds those of group 0, then those of group 1, ...
static void list_members(int places, const pm_batch_place *at, const int *count, int *id) {
    for (int i = 0; i < places; ++i) {
        int before = 0;
        for (int g = 0; g < at[i].group; ++g) {
            before += count[g];
        }
        id[before + at[i].lane] = i;
    }
}

// Returns the number at which the state of a subsystem begins in the arrays of the batch.
static ptrdiff_t start_of(const pm_batch *b, int id) {
    const pm_batch_part *p = &b->part[b->part_at[id].group];
    const int lane = b->part_at[id].lane;
    return p->first + (ptrdiff_t)(lane / p->width) * p->nz * p->width + lane % p->width;
}

static pm_status lay_out(pm_batch *b) {
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part *p = &b->part[i];
        p->first = b->size;
        p->first_lane = b->lanes;
        b->lanes += (int64_t)p->nblock * p->width;
        b->size += (int64_t)p->nblock * p->width * p->nz;
    }
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

pm_status pm_batch_open_parts(pm_batch *b) {
    const pm_scene *scene = b->system->scene;
    const size_t n = (size_t)scene->nsubsystem;
    int *first = pm_arena_array(&b->arena, n, sizeof *first);
    int *count = pm_arena_array(&b->arena, n, sizeof *count);
    int *id = pm_arena_array(&b->arena, n, sizeof *id);
    b->part_at = pm_arena_array(&b->arena, n, sizeof *b->part_at);
    if (first == NULL || count == NULL || id == NULL || b->part_at == NULL) {
        return no_memory();
    }
    b->npart = group_parts(b, first, count);
    b->part = pm_arena_array(&b->arena, (size_t)b->npart, sizeof *b->part);
    if (b->part == NULL) {
        return no_memory();
    }
    list_members(scene->nsubsystem, b->part_at, count, id);
    for (int i = 0; i < b->npart; ++i) {
        const int width = width_of(count[i]);
        b->part[i] = (pm_batch_part){.count = count[i],
                                     .width = width,
                                     .nblock = (count[i] + width - 1) / width,
                                     .nz = scene->subsystem[first[i]].layout.nz,
                                     .id = id};
        id += count[i];
    }
    PM_TRY(lay_out(b));
    for (int i = 0; i < b->npart; ++i) {
        PM_TRY(pm_batch_part_open(&b->part[i], &b->arena, b->system));
    }
    return PM_OK;
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
        const int id = scene->port[p->id[member]].subsystem[which];
        const pm_batch_part *part = &b->part[b->part_at[id].group];
        place[l] = (int)start_of(b, id);
        place[lanes + l] = part->width;
        place[2 * lanes + l] = (int)part->first_lane + b->part_at[id].lane;
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

// Returns true if every subsystem has its ports in the order of the groups. Overwrites `last`
// [nsubsystem].
static bool is_ordered(const pm_batch *b, int *last) {
    const pm_scene *scene = b->system->scene;
    bool ordered = true;
    memset(last, 0, (size_t)scene->nsubsystem * sizeof *last);
    for (int i = 0; i < scene->nport; ++i) {
        for (int end = 0; end < 2; ++end) {
            int *group = &last[scene->port[i].subsystem[end]];
            ordered = ordered && b->port_at[i].group >= *group;
            *group = b->port_at[i].group;
        }
    }
    return ordered;
}

pm_status pm_batch_open_ports(pm_batch *b) {
    const pm_scene *scene = b->system->scene;
    const size_t n = (size_t)scene->nport;
    int *first = pm_arena_array(&b->arena, n, sizeof *first);
    int *count = pm_arena_array(&b->arena, n, sizeof *count);
    int *id = pm_arena_array(&b->arena, n, sizeof *id);
    b->port_at = pm_arena_array(&b->arena, n, sizeof *b->port_at);
    if (first == NULL || count == NULL || id == NULL || b->port_at == NULL) {
        return no_memory();
    }
    b->nport = group_ports(b, first, count);
    b->port = pm_arena_array(&b->arena, (size_t)b->nport, sizeof *b->port);
    if (b->port == NULL) {
        return no_memory();
    }
    list_members(scene->nport, b->port_at, count, id);
    for (int i = 0; i < b->nport; ++i) {
        pm_batch_port *p = &b->port[i];
        const int width = width_of(count[i]);
        *p = (pm_batch_port){
            .count = count[i], .width = width, .nblock = (count[i] + width - 1) / width, .id = id};
        id += count[i];
        for (int end = 0; end < 2; ++end) {
            p->entropy[end] = pm_system_end_has_entropy(b->system, first[i], end);
            PM_TRY(open_end(b, p, &p->end[end], end));
        }
        PM_TRY(open_order(b, p));
        PM_TRY(pm_batch_port_open(p, &b->arena, b->system));
    }
    int *last = pm_arena_array(&b->arena, (size_t)scene->nsubsystem, sizeof *last);
    if (last == NULL) {
        return no_memory();
    }
    b->ordered = is_ordered(b, last);
    return PM_OK;
}
