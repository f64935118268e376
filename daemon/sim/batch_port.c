// The ports of one model: the law of a block in one run, for both ends.
#include <string.h>

#include "base/linalg.h"
#include "model/prediction.h"
#include "sim/batch_parts.h"
#include "sim/program_input.h"

static pm_status open_law(pm_batch_port *p, const pm_system *system) {
    const pm_port_model *model = system->port[p->id[0]];
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    pm_port_nodes input[2];
    pm_node rate[2], next = PM_NO_NODE;
    bool complete = true;
    for (int end = 0; end < 2; ++end) {
        const int ny = p->end[end].ny;
        input[end] =
            (pm_port_nodes){pm_input(g, true, 1, ny), pm_input(g, true, 1, ny),
                            p->entropy[end] ? pm_input(g, true, 1, ny) : PM_NO_NODE, PM_NO_NODE};
    }
    for (int end = 0; end < 2; ++end) {
        pm_port_nodes ends[2] = {input[0], input[1]};
        pm_node degeneracy = PM_NO_NODE;
        rate[end] = pm_port_rate(g, model, (pm_end)end, ends, PM_NO_NODE, &next, &degeneracy);
        complete = complete && rate[end] != PM_NO_NODE && next == PM_NO_NODE;
        if (complete) {
            rate[end] = pm_broadcast_to(g, rate[end], (pm_shape){true, 1, p->end[end].ny});
        }
    }
    const pm_status status =
        complete ? pm_program_open_lanes(&p->law, g, 2, rate, p->width) : PM_OK;
    for (int end = 0; end < 2 && p->law != NULL; ++end) {
        const pm_node node[PM_SHOWN_COUNT] = {input[end].y, input[end].e, input[end].eta};
        for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
            double *value = pm_input_of(p->law, node[i]);
            p->end[end].is_input[i] = value != NULL;
            p->end[end].shown[i] = value != NULL ? value : p->end[end].shown[i];
        }
        p->end[end].law_rate = pm_program_value(p->law, rate[end]);
    }
    pm_graph_close(g);
    return status;
}

// Takes the arrays of one end from the arena. The fluxes need the co-energies, also where the law
// does not depend on them.
static pm_status open_end(pm_batch_end *end, pm_arena *arena, const pm_batch_port *p,
                          bool entropy) {
    const int lanes = p->nblock * p->width;
    const size_t block = (size_t)end->ny * (size_t)p->width;
    end->rate = pm_arena_array(arena, block * (size_t)p->nblock, sizeof *end->rate);
    end->shown[PM_SHOWN_DE] = pm_arena_array(arena, block, sizeof(double));
    end->shown[PM_SHOWN_DS] = entropy ? pm_arena_array(arena, block, sizeof(double)) : NULL;
    if (end->rate == NULL || end->shown[PM_SHOWN_DE] == NULL ||
        (entropy && end->shown[PM_SHOWN_DS] == NULL)) {
        return pm_fail(PM_ENOMEM, "out of memory for a batch of %d ports", p->count);
    }
    return pm_lane_flux_new(&end->flux, arena, lanes);
}

pm_status pm_batch_port_open(pm_batch_port *p, pm_arena *arena, const pm_system *system) {
    p->kept = pm_arena_array(arena, (size_t)p->nblock, sizeof *p->kept);
    p->rested = pm_arena_array(arena, (size_t)p->nblock * (size_t)p->width, sizeof *p->rested);
    if (p->kept == NULL || p->rested == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a batch of %d ports", p->count);
    }
    PM_TRY(open_end(&p->end[0], arena, p, p->entropy[0]));
    PM_TRY(open_end(&p->end[1], arena, p, p->entropy[1]));
    return system->port[p->id[0]]->law->separate ? PM_OK : open_law(p, system);
}

void pm_batch_port_close(pm_batch_port *p) {
    pm_program_close(p->law);
    p->law = NULL;
}

// The places of the subsystems at one end of the ports of a block.
static pm_lane_places places_of(const pm_batch_end *end, int lane) {
    const pm_lane_places *all = &end->place;
    return (pm_lane_places){all->row + lane / PM_LANES, all->first + lane, all->step + lane,
                            all->lane + lane};
}

// Takes what one end shows in a block, and notes in which lanes an input of the law is renewed.
static void show(const pm_batch *b, const pm_batch_port *p, const pm_batch_end *end, int lane,
                 uint64_t *renewed) {
    const double *const from[PM_SHOWN_COUNT] = {b->stage_z, b->dE, b->dS};
    const pm_lane_places places = places_of(end, lane);
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        if (end->shown[i] != NULL) {
            pm_lanes_gather(end->ny, p->width, end->component, &places, from[i], end->shown[i]);
        }
        if (end->is_input[i]) {
            pm_lanes_gather_renewed(p->width, &places, b->renewed[i], end->wanted, renewed);
        }
    }
}

// Evaluates the law of a block unless its rates are kept from a time with the same inputs. The
// rates of a block are kept from the first time on at which it rests.
static void run_block(const pm_batch *b, pm_batch_port *p, int block) {
    uint64_t renewed[PM_BATCH_MOST_LANES];
    const int lane = block * p->width;
    memset(renewed, 0, (size_t)p->width * sizeof *renewed);
    show(b, p, &p->end[0], lane, renewed);
    show(b, p, &p->end[1], lane, renewed);
    const bool any = pm_lanes_any(p->width, renewed);
    if (!pm_lanes_all(p->width, renewed)) {
        for (int l = 0; l < p->width; ++l) {
            p->rested[lane + l] += renewed[l] == 0;
        }
    }
    const bool runs = any || !p->kept[block];
    if (runs) {
        pm_program_run_prepared(p->law, p->width);
    }
    p->kept[block] = !any || !b->ordered;
    for (int i = 0; i < 2 && runs && p->kept[block]; ++i) {
        const ptrdiff_t size = (ptrdiff_t)p->end[i].ny * p->width;
        memcpy(p->end[i].rate + block * size, p->end[i].law_rate, (size_t)size * sizeof(double));
    }
}

// Returns the rates of one end of a block after run_block.
static const double *rate_of(const pm_batch_port *p, const pm_batch_end *end, int block) {
    return p->kept[block] ? end->rate + (ptrdiff_t)block * end->ny * p->width : end->law_rate;
}

// Adds the rates of one end of a block to k, for the lanes from number `begin` to number `last` - 1
// of the block.
static void add_end(const pm_batch_port *p, int end, int block, int begin, int last, double *k) {
    const pm_batch_end *e = &p->end[end];
    const pm_lane_places places = places_of(e, block * p->width);
    pm_lanes_add(e->ny, p->width, e->component, &places, begin, last, rate_of(p, e, block), k);
}

static void add_block(const pm_batch_port *p, int block, double *k) {
    const int left = p->count - block * p->width, used = left < p->width ? left : p->width;
    const pm_batch_order order = p->order[block];
    if (order == PM_ORDER_PORT_BY_PORT) {
        for (int l = 0; l < used; ++l) {
            add_end(p, 0, block, l, l + 1, k);
            add_end(p, 1, block, l, l + 1, k);
        }
        return;
    }
    add_end(p, order == PM_ORDER_A_FIRST ? 0 : 1, block, 0, used, k);
    add_end(p, order == PM_ORDER_A_FIRST ? 1 : 0, block, 0, used, k);
}

void pm_batch_port_couple(const pm_batch *b, pm_batch_port *p, double weight, bool anew,
                          double *k) {
    for (int block = 0; block < p->nblock; ++block) {
        const int lane = block * p->width;
        run_block(b, p, block);
        for (int i = 0; i < 2; ++i) {
            const pm_batch_end *end = &p->end[i];
            const pm_lane_flux flux = {end->flux.energy + lane, end->flux.entropy + lane,
                                       end->flux.energy_gross + lane,
                                       end->flux.entropy_gross + lane};
            pm_lanes_book(end->ny, p->width, weight, anew, end->shown[PM_SHOWN_DE],
                          end->shown[PM_SHOWN_DS], rate_of(p, end, block), &flux);
        }
        if (b->ordered) {
            add_block(p, block, k);
        }
    }
}

void pm_batch_ports_add(const pm_batch *b, double *k) {
    for (int i = 0; i < b->system->scene->nport; ++i) {
        const pm_batch_port *p = &b->port[b->port_at[i].group];
        const int block = b->port_at[i].lane / p->width, lane = b->port_at[i].lane % p->width;
        add_end(p, 0, block, lane, lane + 1, k);
        add_end(p, 1, block, lane, lane + 1, k);
    }
}
