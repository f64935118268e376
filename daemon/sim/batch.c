// Opens and steps a batch, and fills samples. A stage of the integrator is three sweeps over the
// blocks: bulk terms, ports, and then the next state with its exposure, so that a block's numbers
// are in the cache while they are used.
#include "sim/batch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/batch_parts.h"
#include "sim/contact_broadphase.h"

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a batch of subsystems");
}

// --- what a batch can serve ---

static bool has_contact(const pm_system *system, int id) {
    pm_arena arena = {0};
    pm_contact_broadphase b = {0};
    const bool has = pm_contact_broadphase_open(&b, &arena, system->part[id]) != PM_OK ||
                     b.unconstrained != NULL;
    pm_contact_broadphase_close(&b);
    pm_arena_free(&arena);
    return has;
}

static bool can_serve(const pm_system *system) {
    const pm_scene *scene = system->scene;
    const pm_integrator *rk = scene->integrator;
    bool can = !rk->discrete && !rk->multirate && scene->nboundary_input == 0;
    for (int i = 0; i < scene->nsubsystem && can; ++i) {
        can = scene->subsystem[i].substeps == 1 &&
              (system->part_owner[i] != i ||
               (pm_part_has_energy(system->part[i]) && !has_contact(system, i)));
    }
    for (int i = 0; i < scene->nport && can; ++i) {
        can = !system->port[i]->law->separate;
    }
    return can;
}

// Takes room for the fluxes of the subsystem with the most ports.
static pm_status open_books(pm_batch *b) {
    const int *first_end = b->system->scene->first_end;
    int most = 0;
    for (int i = 0; i < b->count; ++i) {
        const int count = first_end[b->id[i] + 1] - first_end[b->id[i]];
        most = count > most ? count : most;
    }
    b->flux = pm_arena_array(&b->arena, (size_t)most, sizeof *b->flux);
    return b->flux == NULL ? no_memory() : PM_OK;
}

pm_status pm_batch_open(pm_batch **batch, const pm_system *system, int count, const int *id) {
    *batch = NULL;
    if (!can_serve(system)) {
        return PM_OK;
    }
    pm_batch *b = calloc(1, sizeof *b);
    if (b == NULL) {
        return no_memory();
    }
    b->system = system;
    b->count = count;
    b->id = id;
    b->integrator = system->scene->integrator;
    pm_batch_set_substeps(b, system->scene->substeps);
    pm_status status = open_books(b);
    status = status == PM_OK ? pm_batch_open_parts(b) : status;
    bool served = status == PM_OK;
    for (int i = 0; i < b->npart && served; ++i) {
        served = b->part[i].exposure != NULL;
    }
    if (served) {
        status = pm_batch_open_ports(b);
        served = status == PM_OK;
    }
    for (int i = 0; i < b->nport && served; ++i) {
        served = b->port[i].law != NULL;
    }
    if (!served) {
        pm_batch_close(b);
        return status;
    }
    *batch = b;
    return PM_OK;
}

void pm_batch_close(pm_batch *batch) {
    if (batch != NULL) {
        for (int i = 0; i < batch->npart && batch->part != NULL; ++i) {
            pm_batch_part_close(&batch->part[i]);
        }
        for (int i = 0; i < batch->nport && batch->port != NULL; ++i) {
            pm_batch_port_close(&batch->port[i]);
        }
        pm_arena_free(&batch->arena);
        free(batch);
    }
}

void pm_batch_set_substeps(pm_batch *batch, int substeps) {
    batch->substeps = substeps;
    batch->h = batch->system->scene->dt / substeps;
}

int pm_batch_lanes(const pm_batch *batch) {
    int lanes = 0;
    for (int i = 0; i < batch->npart; ++i) {
        lanes += batch->part[i].nblock * batch->part[i].width;
    }
    return lanes;
}

// --- steps ---

// Counts the subsystems of a block that end a step outside their training range, and notes whether
// a subsystem may have to end the run.
static void check_block(pm_batch *b, pm_batch_part *p, int block) {
    uint64_t outside[PM_BATCH_MOST_LANES];
    const int lane = block * p->width, block_size = p->nz * p->width;
    const double *z = b->stage_z + p->first + (ptrdiff_t)block * block_size;
    b->doubtful = b->doubtful || pm_lanes_any_not_finite(block_size, z) ||
                  pm_lanes_any_not_finite(p->width, p->E + lane) ||
                  pm_lanes_any_not_finite(p->width, p->S + lane);
    pm_lanes_outside(p->range, p->width, z, outside);
    if (pm_lanes_any(p->width, outside)) {
        b->doubtful = b->doubtful || b->system->scene->largest_departure < INFINITY;
        for (int l = 0; l < p->width; ++l) {
            p->outside[lane + l] += outside[l] != 0;
        }
    }
}

// Returns memory for the next state. A state of a stage is overwritten by the next one.
static double *next_state(const pm_batch *b) {
    if (b->stage_z != b->z) {
        return b->stage_z;
    }
    int i = 0;
    while (b->state[i] == b->z || b->state[i] == b->safe_z) {
        ++i;
    }
    return b->state[i];
}

// Computes the state of a block at the next stage, or after the last stage that after the substep,
// which may be the last one of the step. `before` is the state at the present stage.
static void advance_block(pm_batch *b, pm_batch_part *p, int block, const double *before,
                          bool ends_step) {
    const pm_integrator *rk = b->integrator;
    const bool last = b->stage + 1 == rk->nstage;
    const ptrdiff_t first = p->first + (ptrdiff_t)block * p->nz * p->width;
    if (rk->balanced) {
        pm_batch_substep_book(b, p, block, before);
    }
    pm_lanes_combine(p->nz, p->width, last ? rk->nstage : b->stage + 1,
                     last ? rk->b : rk->a[b->stage + 1], b->h, b->z + first, b->k + first, b->size,
                     before + first, b->stage_z + first,
                     b->renewed[PM_SHOWN_Z] + p->first_lane + (ptrdiff_t)block * p->width);
    pm_batch_part_expose(b, p, block);
    if (last && p->error != NULL) {
        pm_batch_substep_estimate(b, p, block);
    }
    if (last && rk->balanced) {
        pm_batch_substep_project(b, p, block, ends_step);
    }
    if (ends_step) {
        check_block(b, p, block);
    }
}

// Combines the stages so far, exposes all subsystems at the new state, and checks it if it ends the
// step.
static void advance(pm_batch *b, bool ends_substep, bool ends_step) {
    const double *before = b->stage_z;
    b->stage_z = next_state(b);
    for (int i = 0; i < b->npart; ++i) {
        for (int block = 0; block < b->part[i].nblock; ++block) {
            advance_block(b, &b->part[i], block, before, ends_step);
        }
    }
    ++b->part_calls;
    if (ends_substep) {
        b->z = b->stage_z;
    }
}

// Returns the weight of the present stage in the mean over a step.
static double stage_weight(const pm_batch *b) {
    return b->integrator->b[b->stage] / b->substeps;
}

// Returns true in the first round of a step.
static bool is_first(const pm_batch *b) {
    return b->substep == 0 && b->stage == 0;
}

void pm_batch_bulk(pm_batch *b) {
    double *k = b->k + b->stage * b->size;
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part_bulk(b, &b->part[i], stage_weight(b), is_first(b), k + b->part[i].first);
    }
    memset(k + b->parts_size, 0, (size_t)(b->size - b->parts_size) * sizeof *k);
    ++b->bulk_calls;
}

void pm_batch_couple(pm_batch *b) {
    double *k = b->k + b->stage * b->size;
    for (int i = 0; i < b->nport; ++i) {
        pm_batch_port_couple(b, &b->port[i], stage_weight(b), is_first(b), k);
    }
    if (!b->ordered) {
        pm_batch_ports_add(b, k);
    }
    ++b->port_calls;
}

// Marks what the ghosts show as known, until they show something else.
static void rest_ghosts(pm_batch *b) {
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        memset(b->renewed[i] + b->parts_lanes, 0,
               (size_t)(b->lanes - b->parts_lanes) * sizeof *b->renewed[i]);
    }
}

void pm_batch_advance(pm_batch *b) {
    const int nstage = b->integrator->nstage;
    const bool last = b->stage + 1 == nstage;
    advance(b, last, last && b->substep + 1 == b->substeps);
    rest_ghosts(b);
    b->stage = last ? 0 : b->stage + 1;
    b->substep += last;
}

bool pm_batch_completes_step(const pm_batch *b) {
    return b->substep == b->substeps;
}

// Returns the failure of the first subsystem, in the scene's order, whose step has failed.
static pm_status check_all(const pm_batch *b) {
    for (int i = 0; i < b->count; ++i) {
        const pm_batch_place at = b->part_at[b->id[i]];
        PM_TRY(pm_batch_part_check(b, &b->part[at.group], at.lane, b->step + 1));
    }
    return PM_OK;
}

// Marks all numbers that subsystems show as renewed.
static void mark_renewed(pm_batch *b, int count) {
    for (int i = 0; i < count; ++i) {
        memset(b->renewed[i], 0xff, (size_t)b->lanes * sizeof *b->renewed[i]);
    }
}

void pm_batch_expose_anew(pm_batch *b) {
    b->stage_z = b->z;
    b->stage = b->substep = 0;
    b->doubtful = false;
    mark_renewed(b, 1);
    for (int i = 0; i < b->npart; ++i) {
        for (int block = 0; block < b->part[i].nblock; ++block) {
            pm_batch_part_expose(b, &b->part[i], block);
        }
    }
    mark_renewed(b, PM_SHOWN_COUNT);
}

pm_status pm_batch_end_step(pm_batch *b) {
    const pm_status status = b->doubtful ? check_all(b) : PM_OK;
    if (status != PM_OK) {
        b->z = b->safe_z;
        for (int i = 0; i < b->npart; ++i) {
            pm_batch_substep_return(&b->part[i]);
        }
        pm_batch_expose_anew(b);
        return status;
    }
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_substep_keep(&b->part[i]);
    }
    pm_batch_keep_remote_fluxes(b);
    b->substep = 0;
    b->doubtful = false;
    b->safe_z = b->z;
    ++b->step;
    return PM_OK;
}

pm_status pm_batch_step(pm_batch *b) {
    while (!pm_batch_completes_step(b)) {
        pm_batch_bulk(b);
        pm_batch_couple(b);
        pm_batch_advance(b);
    }
    return pm_batch_end_step(b);
}

// --- samples ---

// Returns how often the exposure of a subsystem could have been evaluated in this run.
static long exposure_calls(const pm_batch *b, const pm_batch_part *p, int lane) {
    return b->part_calls + (p->again == NULL ? 0 : p->again[lane]);
}

static void fill_part(const pm_batch *b, const pm_batch_part *p, int lane, const double *z,
                      pm_sample *sample) {
    const int id = p->id[lane];
    double *to = sample->z + b->system->scene->subsystem[id].first;
    for (int c = 0; c < p->nz; ++c) {
        to[c] = z[(ptrdiff_t)c * p->width];
    }
    sample->energy[id] = p->E[lane];
    sample->entropy[id] = p->S[lane];
    sample->bulk_energy[id] = p->bulk.energy[lane];
    sample->bulk_entropy[id] = p->bulk.entropy[lane];
    sample->bulk_gross[2 * id] = p->bulk.energy_gross[lane];
    sample->bulk_gross[2 * id + 1] = p->bulk.entropy_gross[lane];
    sample->outside[id] = p->outside[lane];
    sample->error[id] = p->error == NULL ? 0 : p->error[lane];
    const int *first_end = b->system->scene->first_end + id;
    const long exposures = exposure_calls(b, p, lane);
    const long evaluated = exposures + (p->bulk_term == NULL ? 0 : b->bulk_calls) - p->rested[lane];
    sample->evaluated[id] = evaluated;
    sample->skipped[id] =
        exposures + b->bulk_calls + b->port_calls * (first_end[1] - first_end[0]) - evaluated;
}

static void fill_parts(const pm_batch *b, const pm_batch_part *p, pm_sample *sample) {
    for (int block = 0, left = p->count; block < p->nblock; ++block, left -= p->width) {
        const double *z = b->z + p->first + (ptrdiff_t)block * p->nz * p->width;
        for (int column = 0; column < p->width && column < left; ++column) {
            fill_part(b, p, block * p->width + column, z + column, sample);
        }
    }
}

static void fill_ports(const pm_batch *b, const pm_batch_port *p, pm_sample *sample) {
    const pm_scene *scene = b->system->scene;
    for (int lane = 0; lane < p->count; ++lane) {
        const int id = p->id[lane];
        const long evaluated = b->port_calls - p->rested[lane];
        for (int e = 0; e < 2; ++e) {
            sample->flux[id][e] = pm_lane_flux_at(&p->end[e].flux, lane);
            const int part = scene->port[id].subsystem[e];
            sample->evaluated[part] += evaluated;
            sample->skipped[part] -= evaluated;
        }
    }
}

void pm_batch_fill_sample(const pm_batch *b, pm_sample *sample) {
    for (int i = 0; i < b->npart; ++i) {
        fill_parts(b, &b->part[i], sample);
    }
    for (int i = 0; i < b->nport; ++i) {
        fill_ports(b, &b->port[i], sample);
    }
}

pm_books pm_batch_books(pm_batch *b, int i) {
    const int *first_end = b->system->scene->first_end + b->id[i];
    const int *end_at = b->system->scene->end_at + first_end[0];
    const pm_batch_place at = b->part_at[b->id[i]];
    const pm_batch_part *p = &b->part[at.group];
    const int nflux = first_end[1] - first_end[0];
    const long exposures = exposure_calls(b, p, at.lane);
    long calls = exposures + b->bulk_calls, evaluated = exposures - p->rested[at.lane];
    evaluated += p->bulk_term == NULL ? 0 : b->bulk_calls;
    for (int k = 0; k < nflux; ++k) {
        const pm_batch_place port_at = b->port_at[end_at[k] / 2];
        const pm_batch_port *port = &b->port[port_at.group];
        b->flux[k] = pm_lane_flux_at(&port->end[end_at[k] % 2].flux, port_at.lane);
        calls += b->port_calls;
        evaluated += b->port_calls - port->rested[port_at.lane];
    }
    return (pm_books){.energy = p->E[at.lane],
                      .entropy = p->S[at.lane],
                      .bulk = pm_lane_flux_at(&p->bulk, at.lane),
                      .evaluated = evaluated,
                      .skipped = calls - evaluated,
                      .outside = p->outside[at.lane],
                      .error = p->error == NULL ? 0 : p->error[at.lane],
                      .nflux = nflux,
                      .flux = b->flux};
}

void pm_batch_state(const pm_batch *b, int i, double *z) {
    const pm_batch_address at = pm_batch_address_of(b, b->id[i]);
    const int nz = b->system->scene->subsystem[b->id[i]].layout.nz;
    for (int c = 0; c < nz; ++c) {
        z[c] = b->z[at.first + c * at.step];
    }
}

// --- the start of a run ---

static void clear(const pm_lane_flux *flux, long *rested, bool *kept, int nblock, int width) {
    const size_t lanes = (size_t)nblock * (size_t)width;
    memset(flux->energy, 0, 4 * lanes * sizeof *flux->energy);
    memset(rested, 0, lanes * sizeof *rested);
    memset(kept, 0, (size_t)nblock * sizeof *kept);
}

// The weights may have changed since the last run.
static void prepare_all(const pm_batch *b) {
    for (int i = 0; i < b->npart; ++i) {
        pm_program_prepare(b->part[i].exposure);
        if (b->part[i].bulk_term != NULL) {
            pm_program_prepare(b->part[i].bulk_term);
        }
    }
    for (int i = 0; i < b->nport; ++i) {
        pm_program_prepare(b->port[i].law);
    }
}

void pm_batch_clear(pm_batch *b) {
    b->part_calls = b->bulk_calls = b->port_calls = b->step = 0;
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part *p = &b->part[i];
        clear(&p->bulk, p->rested, p->kept, p->nblock, p->width);
        memset(p->outside, 0, (size_t)p->nblock * (size_t)p->width * sizeof *p->outside);
        pm_batch_substep_start(p);
    }
    for (int i = 0; i < b->nport; ++i) {
        pm_batch_port *p = &b->port[i];
        clear(&p->end[0].flux, p->rested, p->kept, p->nblock, p->width);
        clear(&p->end[1].flux, p->rested, p->kept, p->nblock, p->width);
    }
    for (int i = 0; i < b->nremote; ++i) {
        b->remote[i].flux = (pm_flux){0};
    }
}

void pm_batch_set_state(pm_batch *batch, const double *z) {
    pm_batch *b = batch;
    const pm_scene *scene = b->system->scene;
    b->z = b->safe_z = b->state[0];
    for (int i = 0; i < b->npart; ++i) {
        const pm_batch_part *p = &b->part[i];
        for (int lane = 0; lane < p->nblock * p->width; ++lane) {
            const int id = p->id[lane < p->count ? lane : p->count - 1];
            double *to =
                b->z + p->first + (ptrdiff_t)(lane / p->width) * p->nz * p->width + lane % p->width;
            for (int c = 0; c < p->nz; ++c) {
                to[(ptrdiff_t)c * p->width] = z[scene->subsystem[id].first + c];
            }
        }
    }
    prepare_all(b);
    pm_batch_expose_anew(b);
    pm_batch_clear(b);
}
