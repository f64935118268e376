// The end of a substep of a batch: the estimate of its error, for an adaptive step, and the move
// onto the energy and entropy that follow from the fluxes, for a balanced integrator. Each lane
// computes what subsystem_stage.c computes for one subsystem, with the same bits.
#include <math.h>
#include <string.h>

#include "sim/batch_parts.h"

// The limit is that of subsystem_stage.c.
#define MOST_MOVES 3

pm_status pm_batch_substep_open(pm_batch_part *p, pm_arena *arena, const pm_scene *scene) {
    const size_t lanes = (size_t)p->nblock * (size_t)p->width;
    bool made = true;
    if (scene->tolerance > 0) {
        p->error = pm_arena_array(arena, lanes, sizeof *p->error);
        p->size = pm_arena_array(arena, lanes * (size_t)p->layout.ngroup, sizeof *p->size);
        made = p->error != NULL && p->size != NULL;
    }
    if (scene->integrator->balanced) {
        p->projection = pm_arena_array(arena, lanes, sizeof *p->projection);
        p->safe_projection = pm_arena_array(arena, lanes, sizeof *p->safe_projection);
        p->again = pm_arena_array(arena, lanes, sizeof *p->again);
        p->lane_values = pm_arena_array(arena, 4 * (size_t)p->nz, sizeof *p->lane_values);
        p->coupled =
            pm_arena_array(arena, PM_SHOWN_COUNT * (size_t)(p->nz * p->width), sizeof *p->coupled);
        made = made && p->projection != NULL && p->safe_projection != NULL && p->again != NULL &&
               p->lane_values != NULL && p->coupled != NULL;
    }
    return made ? PM_OK
                : pm_fail(PM_ENOMEM, "out of memory for a batch of %d subsystems", p->count);
}

void pm_batch_substep_start(pm_batch_part *p) {
    const int lanes = p->nblock * p->width;
    if (p->error != NULL) {
        memset(p->error, 0, (size_t)lanes * sizeof *p->error);
        memset(p->size, 0, (size_t)lanes * (size_t)p->layout.ngroup * sizeof *p->size);
    }
    if (p->projection != NULL) {
        memset(p->again, 0, (size_t)lanes * sizeof *p->again);
        for (int l = 0; l < lanes; ++l) {
            pm_invariant_projection_start(&p->projection[l], p->E[l], p->S[l]);
        }
        pm_batch_substep_keep(p);
    }
}

void pm_batch_substep_keep(pm_batch_part *p) {
    if (p->projection != NULL) {
        memcpy(p->safe_projection, p->projection,
               (size_t)p->nblock * (size_t)p->width * sizeof *p->projection);
    }
}

void pm_batch_substep_return(pm_batch_part *p) {
    if (p->projection != NULL) {
        memcpy(p->projection, p->safe_projection,
               (size_t)p->nblock * (size_t)p->width * sizeof *p->projection);
    }
}

// --- the error ---

// Adds the squares of component c of the state and of its error in every lane.
static void add_squares(const pm_batch *b, int lanes, const double *z, const double *k,
                        double *state, double *error) {
    const pm_integrator *rk = b->integrator;
    double sum[PM_BATCH_MOST_LANES] = {0};
    for (int i = 0; i < rk->nstage; ++i) {
        const double weight = b->h * rk->error_weights[i];
        const double *stage = k + i * b->size;
        for (int l = 0; l < lanes; ++l) {
            sum[l] += weight * stage[l];
        }
    }
    for (int l = 0; l < lanes; ++l) {
        state[l] += z[l] * z[l];
        error[l] += sum[l] * sum[l];
    }
}

void pm_batch_substep_estimate(const pm_batch *b, pm_batch_part *p, int block) {
    const int w = p->width, lane = block * w;
    const ptrdiff_t first = p->first + (ptrdiff_t)block * p->nz * w;
    double *worst = p->error + lane;
    if (b->substep == 0) {
        memset(worst, 0, (size_t)w * sizeof *worst);
    }
    for (int i = 0; i < p->layout.ngroup; ++i) {
        const pm_group *group = &p->layout.group[i];
        double *size = p->size + (ptrdiff_t)i * p->nblock * w + lane;
        double state[PM_BATCH_MOST_LANES] = {0}, error[PM_BATCH_MOST_LANES] = {0};
        for (int c = group->first; c < group->first + group->size; ++c) {
            const ptrdiff_t at = first + (ptrdiff_t)c * w;
            add_squares(b, w, b->z + at, b->k + at, state, error);
        }
        for (int l = 0; l < w; ++l) {
            size[l] = fmax(size[l], sqrt(state[l]));
            worst[l] = fmax(worst[l], size[l] > 0 ? sqrt(error[l]) / size[l] : 0);
        }
    }
}

// --- energy and entropy ---

// Copies the components of one lane, which begin at `from`, to `to` [nz].
static const double *take(const pm_batch_part *p, const double *from, double *to) {
    for (int c = 0; c < p->nz; ++c) {
        to[c] = from[(ptrdiff_t)c * p->width];
    }
    return to;
}

// Keeps what a block shows at the last stage of a substep, at the state z.
static void keep_coupled(const pm_batch *b, pm_batch_part *p, int block, const double *z) {
    const int size = p->nz * p->width;
    const double *const from[PM_SHOWN_COUNT] = {z, b->dE, b->dS};
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        memcpy(p->coupled + (ptrdiff_t)i * size, from[i] + p->first + (ptrdiff_t)block * size,
               (size_t)size * sizeof(double));
    }
}

void pm_batch_substep_book(const pm_batch *b, pm_batch_part *p, int block, const double *z) {
    const double weight = b->h * b->integrator->b[b->stage];
    const double *k = b->k + b->stage * b->size;
    double *dE = p->lane_values, *dS = dE + p->nz, *rate = dS + p->nz;
    for (int l = 0; l < p->width; ++l) {
        const ptrdiff_t at = p->first + (ptrdiff_t)block * p->nz * p->width + l;
        pm_invariant_projection_book(&p->projection[block * p->width + l], b->stage == 0, weight,
                                     p->nz, take(p, b->dE + at, dE),
                                     p->exposure_dS == NULL ? NULL : take(p, b->dS + at, dS),
                                     take(p, k + at, rate));
    }
    if (b->stage + 1 == b->integrator->nstage) {
        keep_coupled(b, p, block, z);
    }
}

// Moves the new state of the lanes for which `moving` is true. Clears `moving` where no move is
// needed, and sets renewed [width] to the components that have got other bits. Returns true if a
// lane was moved.
static bool move(pm_batch *b, pm_batch_part *p, int block, bool *moving, uint64_t *renewed) {
    double *start = p->lane_values, *z = start + p->nz, *dE = z + p->nz, *dS = dE + p->nz;
    bool any = false;
    for (int l = 0; l < p->width; ++l) {
        renewed[l] = 0;
        if (!moving[l]) {
            continue;
        }
        const int lane = block * p->width + l;
        const ptrdiff_t at = p->first + (ptrdiff_t)block * p->nz * p->width + l;
        take(p, b->stage_z + at, z);
        moving[l] = pm_invariant_projection_move(
            &p->projection[lane], &p->layout, take(p, b->z + at, start), p->E[lane], p->S[lane],
            take(p, b->dE + at, dE), p->exposure_dS == NULL ? NULL : take(p, b->dS + at, dS), z);
        any = any || moving[l];
        for (int c = 0; c < p->nz && moving[l]; ++c) {
            double *number = b->stage_z + at + (ptrdiff_t)c * p->width;
            const uint64_t bit = (uint64_t)1 << (c & 63);
            renewed[l] |= memcmp(number, &z[c], sizeof z[c]) != 0 ? bit : 0;
            *number = z[c];
        }
    }
    return any;
}

// Exposes a block once more after a move.
static void expose_again(pm_batch *b, pm_batch_part *p, int block, const bool *moving,
                         const uint64_t *moved) {
    const int lane = block * p->width;
    long rested[PM_BATCH_MOST_LANES];
    memcpy(rested, p->rested + lane, (size_t)p->width * sizeof *rested);
    memcpy(b->renewed[PM_SHOWN_Z] + p->first_lane + lane, moved, (size_t)p->width * sizeof *moved);
    pm_batch_part_expose(b, p, block);
    for (int l = 0; l < p->width; ++l) {
        p->rested[lane + l] = rested[l] + (moving[l] && moved[l] == 0);
        p->again[lane + l] += moving[l];
    }
}

// Notes in b->renewed what differs from the last coupling.
static void renew(pm_batch *b, pm_batch_part *p, int block) {
    const int size = p->nz * p->width;
    const double *const now[PM_SHOWN_COUNT] = {b->stage_z, b->dE, b->dS};
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        pm_lanes_renew(p->nz, p->width, now[i] + p->first + (ptrdiff_t)block * size,
                       p->coupled + (ptrdiff_t)i * size,
                       b->renewed[i] + p->first_lane + (ptrdiff_t)block * p->width);
    }
}

void pm_batch_substep_project(pm_batch *b, pm_batch_part *p, int block, bool ends_step) {
    bool moving[PM_BATCH_MOST_LANES];
    uint64_t moved[PM_BATCH_MOST_LANES];
    const int lane = block * p->width;
    for (int l = 0; l < p->width; ++l) {
        moving[l] = true;
    }
    int moves = 0;
    while (moves < MOST_MOVES && move(b, p, block, moving, moved)) {
        expose_again(b, p, block, moving, moved);
        ++moves;
    }
    if (moves > 0) {
        renew(b, p, block);
    }
    // A subsystem alone looks at its state again at the end of a step.
    for (int l = 0; l < p->width && ends_step; ++l) {
        p->again[lane + l] += !moving[l];
        p->rested[lane + l] += !moving[l];
    }
}
