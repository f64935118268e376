// The ports of one model: the law of a block in one run, for both ends.
#include <string.h>

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
        p->end[end].input[0] = pm_input_of(p->law, input[end].y);
        p->end[end].input[1] = pm_input_of(p->law, input[end].e);
        p->end[end].input[2] = pm_input_of(p->law, input[end].eta);
        p->end[end].law_rate = pm_program_value(p->law, rate[end]);
    }
    pm_graph_close(g);
    return status;
}

static pm_status open_end(pm_batch_end *end, pm_arena *arena, int lanes) {
    const size_t n = (size_t)lanes * (size_t)end->ny;
    end->shown = pm_arena_array(arena, 3 * n, sizeof *end->shown);
    end->rate = pm_arena_array(arena, n, sizeof *end->rate);
    if (end->shown == NULL || end->rate == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a batch of %d ports", lanes);
    }
    return pm_lane_flux_new(&end->flux, arena, lanes);
}

pm_status pm_batch_port_open(pm_batch_port *p, pm_arena *arena, const pm_system *system) {
    const int lanes = p->nblock * p->width;
    p->renewed = pm_arena_array(arena, (size_t)p->width, sizeof *p->renewed);
    p->evaluated = pm_arena_array(arena, (size_t)lanes, sizeof *p->evaluated);
    if (p->renewed == NULL || p->evaluated == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a batch of %d ports", p->count);
    }
    PM_TRY(open_end(&p->end[0], arena, lanes));
    PM_TRY(open_end(&p->end[1], arena, lanes));
    return system->port[p->id[0]]->law->separate ? PM_OK : open_law(p, system);
}

void pm_batch_port_close(pm_batch_port *p) {
    pm_program_close(p->law);
    p->law = NULL;
}

// Takes what one end shows in a block, and notes which lanes have changed an input of the law.
static void show(pm_batch_port *p, const pm_batch *batch, const pm_batch_end *end, int block) {
    const double *const from[3] = {batch->stage_z, batch->dE, batch->dS};
    const int lane = block * p->width, size = end->ny * p->width;
    for (int i = 0; i < 3; ++i) {
        double *shown = end->shown + ((ptrdiff_t)block * 3 + i) * size;
        pm_lanes_gather(end->ny, p->width, end->component, from[i], end->first + lane,
                        end->step + lane, shown, end->input[i] != NULL ? p->renewed : NULL);
    }
}

static void run_block(pm_batch_port *p, int block) {
    for (int i = 0; i < 6; ++i) {
        const pm_batch_end *end = &p->end[i / 3];
        const int size = end->ny * p->width;
        if (end->input[i % 3] != NULL) {
            memcpy(end->input[i % 3], end->shown + ((ptrdiff_t)block * 3 + i % 3) * size,
                   (size_t)size * sizeof *end->shown);
        }
    }
    pm_program_run_lanes(p->law);
    for (int i = 0; i < 2; ++i) {
        const pm_batch_end *end = &p->end[i];
        const int size = end->ny * p->width;
        memcpy(end->rate + (ptrdiff_t)block * size, end->law_rate,
               (size_t)size * sizeof *end->rate);
    }
}

static void couple_block(pm_batch_port *p, const pm_batch *batch, int block, double weight) {
    const int lane = block * p->width;
    for (int l = 0; l < p->width; ++l) {
        p->renewed[l] = !p->known;
    }
    show(p, batch, &p->end[0], block);
    show(p, batch, &p->end[1], block);
    if (pm_lanes_any(p->width, p->renewed)) {
        run_block(p, block);
        for (int l = 0; l < p->width; ++l) {
            p->evaluated[lane + l] += p->renewed[l] != 0;
        }
    }
    for (int i = 0; i < 2; ++i) {
        const pm_batch_end *end = &p->end[i];
        const ptrdiff_t size = (ptrdiff_t)end->ny * p->width;
        const double *shown = end->shown + block * 3 * size;
        const pm_lane_flux flux = {end->flux.energy + lane, end->flux.entropy + lane,
                                   end->flux.energy_gross + lane, end->flux.entropy_gross + lane};
        pm_lanes_book(end->ny, p->width, weight, shown + size, shown + 2 * size,
                      end->rate + block * size, &flux);
    }
}

void pm_batch_port_couple(pm_batch_port *p, const pm_batch *batch, double weight) {
    for (int block = 0; block < p->nblock; ++block) {
        couple_block(p, batch, block, weight);
    }
    p->known = true;
}
