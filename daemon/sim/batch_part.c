// The subsystems of one model: exposure and bulk term of a block in one run each.
#include <string.h>

#include "sim/batch_parts.h"
#include "sim/program_input.h"
#include "sim/step_checks.h"

#define OUTPUTS 4

static pm_status open_exposure(pm_batch_part *p, const pm_part *part) {
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, p->nz);
    pm_node wanted[OUTPUTS] = {pm_part_energy(g, part, z), pm_part_entropy(g, part, z)};
    pm_part_coenergies(g, part, PM_NO_NODE, z, &wanted[2], &wanted[3]);
    const double **const value[OUTPUTS] = {&p->exposure_E, &p->exposure_S, &p->exposure_dE,
                                           &p->exposure_dS};
    pm_node output[OUTPUTS];
    int count = 0;
    for (int i = 0; i < OUTPUTS; ++i) {
        if (wanted[i] != PM_NO_NODE) {
            output[count++] = pm_broadcast_to(
                g, wanted[i], (pm_shape){true, 1, pm_graph_shape(g, wanted[i]).cols});
        }
    }
    const pm_status status = pm_program_open_lanes(&p->exposure, g, count, output, p->width);
    if (p->exposure != NULL) {
        p->exposure_z = pm_program_value(p->exposure, z);
        count = 0;
        for (int i = 0; i < OUTPUTS; ++i) {
            *value[i] =
                wanted[i] == PM_NO_NODE ? NULL : pm_program_value(p->exposure, output[count++]);
        }
    }
    pm_graph_close(g);
    return status;
}

// Sets *served to false if the bulk term exists, but cannot be run in lanes.
static pm_status open_bulk(pm_batch_part *p, const pm_part *part, bool *served) {
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    const pm_node z = pm_input(g, true, 1, p->nz), dE = pm_input(g, true, 1, p->nz);
    const pm_node dS = p->exposure_dS == NULL ? PM_NO_NODE : pm_input(g, true, 1, p->nz);
    pm_node degeneracy = PM_NO_NODE;
    pm_node rate = pm_part_bulk(g, part, z, dE, dS, &degeneracy);
    pm_status status = PM_OK;
    if (rate != PM_NO_NODE) {
        rate = pm_broadcast_to(g, rate, (pm_shape){true, 1, p->nz});
        status = pm_program_open_lanes(&p->bulk_term, g, 1, &rate, p->width);
        *served = p->bulk_term != NULL;
    }
    if (p->bulk_term != NULL) {
        p->bulk_input[PM_SHOWN_Z] = pm_input_of(p->bulk_term, z);
        p->bulk_input[PM_SHOWN_DE] = pm_input_of(p->bulk_term, dE);
        p->bulk_input[PM_SHOWN_DS] = pm_input_of(p->bulk_term, dS);
        p->bulk_rate = pm_program_value(p->bulk_term, rate);
    }
    pm_graph_close(g);
    return status;
}

pm_status pm_batch_part_open(pm_batch_part *p, pm_arena *arena, const pm_system *system) {
    const pm_part *part = system->part[p->id[0]];
    const int lanes = p->nblock * p->width;
    bool served = true;
    p->layout = part->layout;
    p->range = pm_training_range_of(part);
    PM_TRY(open_exposure(p, part));
    if (p->exposure == NULL || p->exposure_E == NULL || p->exposure_dE == NULL) {
        pm_batch_part_close(p);
        return PM_OK;
    }
    PM_TRY(open_bulk(p, part, &served));
    if (!served) {
        pm_batch_part_close(p);
        return PM_OK;
    }
    p->rate = pm_arena_array(arena, (size_t)lanes * (size_t)p->nz, sizeof *p->rate);
    p->kept = pm_arena_array(arena, (size_t)p->nblock, sizeof *p->kept);
    p->E = pm_arena_array(arena, (size_t)lanes, sizeof *p->E);
    p->S = pm_arena_array(arena, (size_t)lanes, sizeof *p->S);
    p->rested = pm_arena_array(arena, (size_t)lanes, sizeof *p->rested);
    p->outside = pm_arena_array(arena, (size_t)lanes, sizeof *p->outside);
    p->one = pm_arena_array(arena, (size_t)p->nz, sizeof *p->one);
    if (p->rate == NULL || p->kept == NULL || p->E == NULL || p->S == NULL || p->rested == NULL ||
        p->outside == NULL || p->one == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a batch of %d subsystems", p->count);
    }
    return pm_lane_flux_new(&p->bulk, arena, lanes);
}

void pm_batch_part_close(pm_batch_part *p) {
    pm_program_close(p->exposure);
    pm_program_close(p->bulk_term);
    p->exposure = p->bulk_term = NULL;
}

static void copy(double *to, const double *from, int count) {
    if (to != NULL && from != NULL) {
        memcpy(to, from, (size_t)count * sizeof *to);
    }
}

// Counts the lanes of which nothing is renewed.
static void count_resting(int lanes, const uint64_t *renewed, long *rested) {
    if (pm_lanes_all(lanes, renewed)) {
        return;
    }
    for (int l = 0; l < lanes; ++l) {
        rested[l] += renewed[l] == 0;
    }
}

void pm_batch_part_expose(pm_batch *b, pm_batch_part *p, int block) {
    const int lane = block * p->width, block_size = p->nz * p->width;
    const ptrdiff_t first = p->first + (ptrdiff_t)block * block_size;
    uint64_t *renewed[PM_SHOWN_COUNT];
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        renewed[i] = b->renewed[i] + p->first_lane + lane;
    }
    count_resting(p->width, renewed[PM_SHOWN_Z], p->rested + lane);
    if (!pm_lanes_any(p->width, renewed[PM_SHOWN_Z])) {
        memset(renewed[PM_SHOWN_DE], 0, (size_t)p->width * sizeof(uint64_t));
        memset(renewed[PM_SHOWN_DS], 0, (size_t)p->width * sizeof(uint64_t));
        return;
    }
    copy(p->exposure_z, b->stage_z + first, block_size);
    pm_program_run_prepared(p->exposure, p->width);
    copy(p->E + lane, p->exposure_E, p->width);
    copy(p->S + lane, p->exposure_S, p->width);
    pm_lanes_renew(p->nz, p->width, p->exposure_dE, b->dE + first, renewed[PM_SHOWN_DE]);
    if (p->exposure_dS != NULL) {
        pm_lanes_renew(p->nz, p->width, p->exposure_dS, b->dS + first, renewed[PM_SHOWN_DS]);
    }
}

// Notes in which lanes of a block an input of the bulk term is renewed. Returns true if there is
// one.
static bool note_renewed(const pm_batch *b, const pm_batch_part *p, int lane, uint64_t *renewed) {
    memset(renewed, 0, (size_t)p->width * sizeof *renewed);
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        const uint64_t *from = b->renewed[i] + p->first_lane + lane;
        for (int l = 0; l < p->width && p->bulk_input[i] != NULL; ++l) {
            renewed[l] |= from[l];
        }
    }
    return pm_lanes_any(p->width, renewed);
}

// Writes the rate of the bulk term of a block to `rate`.
static void run_bulk(const pm_batch *b, const pm_batch_part *p, ptrdiff_t first, double *rate) {
    const double *const from[PM_SHOWN_COUNT] = {b->stage_z, b->dE, b->dS};
    const int block_size = p->nz * p->width;
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        copy(p->bulk_input[i], from[i] + first, block_size);
    }
    pm_program_run_prepared(p->bulk_term, p->width);
    copy(rate, p->bulk_rate, block_size);
}

static void run_block(const pm_batch *b, pm_batch_part *p, int block, double *k) {
    const int lane = block * p->width, block_size = p->nz * p->width;
    const ptrdiff_t first = p->first + (ptrdiff_t)block * block_size;
    double *rate = p->rate + (ptrdiff_t)block * block_size;
    uint64_t renewed[PM_BATCH_MOST_LANES];
    const bool any = note_renewed(b, p, lane, renewed);
    count_resting(p->width, renewed, p->rested + lane);
    if (any) {
        run_bulk(b, p, first, k);
    } else {
        if (!p->kept[block]) {
            run_bulk(b, p, first, rate);
        }
        copy(k, rate, block_size);
    }
    p->kept[block] = !any;
}

void pm_batch_part_bulk(const pm_batch *b, pm_batch_part *p, double weight, bool anew, double *k) {
    const ptrdiff_t block_size = (ptrdiff_t)p->nz * p->width;
    if (p->bulk_term == NULL) {
        memset(k, 0, (size_t)p->nblock * (size_t)block_size * sizeof *k);
        return;
    }
    for (int block = 0; block < p->nblock; ++block) {
        const int lane = block * p->width;
        const ptrdiff_t first = p->first + block * block_size;
        double *rate = k + block * block_size;
        run_block(b, p, block, rate);
        const pm_lane_flux flux = {p->bulk.energy + lane, p->bulk.entropy + lane,
                                   p->bulk.energy_gross + lane, p->bulk.entropy_gross + lane};
        pm_lanes_book(p->nz, p->width, weight, anew, b->dE + first,
                      p->exposure_dS == NULL ? NULL : b->dS + first, rate, &flux);
    }
    // Lanes without a subsystem stay where they are.
    const int used = p->count - (p->nblock - 1) * p->width;
    for (int c = 0; c < p->nz; ++c) {
        double *row = k + ((ptrdiff_t)(p->nblock - 1) * p->nz + c) * p->width;
        memset(row + used, 0, (size_t)(p->width - used) * sizeof *row);
    }
}

pm_status pm_batch_part_check(const pm_batch *b, const pm_batch_part *p, int lane, long step) {
    const pm_scene *scene = b->system->scene;
    const pm_scene_subsystem *subsystem = &scene->subsystem[p->id[lane]];
    const ptrdiff_t first =
        p->first + (ptrdiff_t)(lane / p->width) * p->nz * p->width + lane % p->width;
    for (int c = 0; c < p->nz; ++c) {
        p->one[c] = b->z[first + (ptrdiff_t)c * p->width];
    }
    bool outside;
    PM_TRY(pm_step_check_finite(subsystem, p->one));
    PM_TRY(pm_step_check_potentials(subsystem, p->E[lane], p->S[lane]));
    return pm_step_check_range(scene, subsystem, p->range, p->one, step, &outside);
}
