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
        p->bulk_z = pm_input_of(p->bulk_term, z);
        p->bulk_dE = pm_input_of(p->bulk_term, dE);
        p->bulk_dS = pm_input_of(p->bulk_term, dS);
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
    p->E = pm_arena_array(arena, (size_t)lanes, sizeof *p->E);
    p->S = pm_arena_array(arena, (size_t)lanes, sizeof *p->S);
    p->changed = pm_arena_array(arena, (size_t)lanes, sizeof *p->changed);
    p->renewed = pm_arena_array(arena, (size_t)lanes, sizeof *p->renewed);
    p->evaluated = pm_arena_array(arena, (size_t)lanes, sizeof *p->evaluated);
    p->outside = pm_arena_array(arena, (size_t)lanes, sizeof *p->outside);
    p->one = pm_arena_array(arena, (size_t)p->nz, sizeof *p->one);
    if (p->rate == NULL || p->E == NULL || p->S == NULL || p->changed == NULL ||
        p->renewed == NULL || p->evaluated == NULL || p->outside == NULL || p->one == NULL) {
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

static void count_changed(int lanes, const uint64_t *changed, long *count) {
    for (int l = 0; l < lanes; ++l) {
        count[l] += changed[l] != 0;
    }
}

static void expose_block(pm_batch_part *p, int block) {
    const int lane = block * p->width, block_size = p->nz * p->width;
    const ptrdiff_t first = (ptrdiff_t)block * block_size;
    uint64_t *changed = p->changed + lane, *renewed = p->renewed + lane;
    memset(renewed, 0, (size_t)p->width * sizeof *renewed);
    if (!pm_lanes_any(p->width, changed)) {
        return;
    }
    copy(p->exposure_z, p->stage_z + first, block_size);
    pm_program_run_lanes(p->exposure);
    copy(p->E + lane, p->exposure_E, p->width);
    copy(p->S + lane, p->exposure_S, p->width);
    // An input of the bulk term has changed if its bits have, whatever the state's have done.
    if (p->bulk_dE != NULL) {
        pm_lanes_renew(p->nz, p->width, p->exposure_dE, p->dE + first, renewed);
    } else {
        copy(p->dE + first, p->exposure_dE, block_size);
    }
    if (p->exposure_dS != NULL && p->bulk_dS != NULL) {
        pm_lanes_renew(p->nz, p->width, p->exposure_dS, p->dS + first, renewed);
    } else {
        copy(p->dS + first, p->exposure_dS, block_size);
    }
    for (int l = 0; l < p->width && p->bulk_z != NULL; ++l) {
        renewed[l] |= changed[l];
    }
    count_changed(p->width, changed, p->evaluated + lane);
    memset(changed, 0, (size_t)p->width * sizeof *changed);
}

void pm_batch_part_expose(pm_batch_part *p) {
    for (int block = 0; block < p->nblock; ++block) {
        expose_block(p, block);
    }
}

void pm_batch_part_bulk(pm_batch_part *p, double weight, double *k) {
    const int block_size = p->nz * p->width;
    if (p->bulk_term == NULL) {
        memset(k, 0, (size_t)p->nblock * (size_t)block_size * sizeof *k);
        return;
    }
    for (int block = 0; block < p->nblock; ++block) {
        const int lane = block * p->width;
        const ptrdiff_t first = (ptrdiff_t)block * block_size;
        const double *dS = p->exposure_dS == NULL ? NULL : p->dS + first;
        if (pm_lanes_any(p->width, p->renewed + lane)) {
            copy(p->bulk_z, p->stage_z + first, block_size);
            copy(p->bulk_dE, p->dE + first, block_size);
            copy(p->bulk_dS, dS, block_size);
            pm_program_run_lanes(p->bulk_term);
            copy(p->rate + first, p->bulk_rate, block_size);
            count_changed(p->width, p->renewed + lane, p->evaluated + lane);
        }
        copy(k + first, p->rate + first, block_size);
        const pm_lane_flux flux = {p->bulk.energy + lane, p->bulk.entropy + lane,
                                   p->bulk.energy_gross + lane, p->bulk.entropy_gross + lane};
        pm_lanes_book(p->nz, p->width, weight, p->dE + first, dS, k + first, &flux);
    }
    // Lanes without a subsystem stay where they are.
    const int used = p->count - (p->nblock - 1) * p->width;
    for (int c = 0; c < p->nz; ++c) {
        double *row = k + ((ptrdiff_t)(p->nblock - 1) * p->nz + c) * p->width;
        memset(row + used, 0, (size_t)(p->width - used) * sizeof *row);
    }
}

pm_status pm_batch_part_check(const pm_batch_part *p, const pm_scene *scene, int lane, long step) {
    const pm_scene_subsystem *subsystem = &scene->subsystem[p->id[lane]];
    double *z = p->one;
    const ptrdiff_t first = (ptrdiff_t)(lane / p->width) * p->nz * p->width + lane % p->width;
    for (int c = 0; c < p->nz; ++c) {
        z[c] = p->z[first + (ptrdiff_t)c * p->width];
    }
    bool outside;
    pm_status status = pm_step_check_finite(subsystem, z);
    if (status == PM_OK) {
        status = pm_step_check_potentials(subsystem, p->E[lane], p->S[lane]);
    }
    if (status == PM_OK) {
        status = pm_step_check_range(scene, subsystem, p->range, z, step, &outside);
    }
    return status;
}
