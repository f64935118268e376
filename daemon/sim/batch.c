// Opens and steps a batch, and fills samples.
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
    bool can = !rk->discrete && !rk->multirate && !rk->balanced && scene->tolerance == 0 &&
               scene->nboundary_input == 0;
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

pm_status pm_batch_open(pm_batch **batch, const pm_system *system) {
    *batch = NULL;
    if (!can_serve(system)) {
        return PM_OK;
    }
    pm_batch *b = calloc(1, sizeof *b);
    if (b == NULL) {
        return no_memory();
    }
    b->system = system;
    b->integrator = system->scene->integrator;
    b->h = system->scene->dt / system->scene->substeps;
    pm_status status = pm_batch_open_parts(b);
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

int pm_batch_lanes(const pm_batch *batch) {
    int lanes = 0;
    for (int i = 0; i < batch->npart; ++i) {
        lanes += batch->part[i].nblock * batch->part[i].width;
    }
    return lanes;
}

// --- steps ---

static void expose(pm_batch *b) {
    for (int i = 0; i < b->npart && !b->exposed; ++i) {
        pm_batch_part_expose(&b->part[i]);
    }
    b->part_calls += !b->exposed;
    b->exposed = true;
}

// Adds the rates of one port to k.
static inline void add_rate(const pm_batch_port *p, int block, int column, double *k) {
    const int lane = block * p->width + column;
    for (int e = 0; e < 2; ++e) {
        const pm_batch_end *end = &p->end[e];
        const double *rate = end->rate + (ptrdiff_t)block * end->ny * p->width + column;
        double *to = k + end->first[lane];
        const int step = end->step[lane];
        for (int c = 0; c < end->ny; ++c) {
            to[(ptrdiff_t)end->component[c] * step] += rate[(ptrdiff_t)c * p->width];
        }
    }
}

// Adds the rates of all ports to k, port by port in the scene's order, so that each subsystem sums
// them up as it does alone.
static void add_rates(const pm_batch *b, double *k) {
    if (b->nport == 1) {
        const pm_batch_port *p = &b->port[0];
        for (int block = 0, left = p->count; block < p->nblock; ++block, left -= p->width) {
            for (int column = 0; column < p->width && column < left; ++column) {
                add_rate(p, block, column, k);
            }
        }
        return;
    }
    for (int i = 0; i < b->system->scene->nport; ++i) {
        const pm_batch_port *p = &b->port[b->port_at[i].group];
        const int lane = b->port_at[i].lane;
        add_rate(p, lane / p->width, lane % p->width, k);
    }
}

// One round: the rates at a stage, then the state of the next stage.
static void step_stage(pm_batch *b, int stage) {
    const pm_integrator *rk = b->integrator;
    const double weight = rk->b[stage] / b->system->scene->substeps;
    double *k = b->k + stage * b->size;
    expose(b);
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part_bulk(&b->part[i], weight, k + (b->part[i].z - b->z));
    }
    for (int i = 0; i < b->nport; ++i) {
        pm_batch_port_couple(&b->port[i], b, weight);
    }
    add_rates(b, k);
    ++b->bulk_calls;
    ++b->port_calls;
    const bool last = stage + 1 == rk->nstage;
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part *p = &b->part[i];
        const int size = p->nz * p->width;
        for (int block = 0; block < p->nblock; ++block) {
            const ptrdiff_t first = (ptrdiff_t)block * size;
            pm_lanes_combine(p->nz, p->width, last ? rk->nstage : stage + 1,
                             last ? rk->b : rk->a[stage + 1], b->h, p->z + first,
                             b->k + (p->z - b->z) + first, b->size, p->stage_z + first,
                             p->changed + (ptrdiff_t)block * p->width);
        }
    }
    b->exposed = false;
    if (last) {
        memcpy(b->z, b->stage_z, (size_t)b->size * sizeof *b->z);
    }
}

// --- the end of a step ---

static void clear_flux(pm_lane_flux *flux, int lanes) {
    memset(flux->energy, 0, 4 * (size_t)lanes * sizeof *flux->energy);
}

static void clear_fluxes(pm_batch *b) {
    for (int i = 0; i < b->npart; ++i) {
        clear_flux(&b->part[i].bulk, b->part[i].nblock * b->part[i].width);
    }
    for (int i = 0; i < b->nport; ++i) {
        for (int end = 0; end < 2; ++end) {
            clear_flux(&b->port[i].end[end].flux, b->port[i].nblock * b->port[i].width);
        }
    }
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
    sample->evaluated[id] = p->evaluated[lane];
    sample->outside[id] = p->outside[lane];
    const int *first_end = b->system->scene->first_end + id;
    sample->skipped[id] = b->part_calls + b->bulk_calls +
                          b->port_calls * (first_end[1] - first_end[0]) - p->evaluated[lane];
}

static void fill_parts(const pm_batch *b, const pm_batch_part *p, pm_sample *sample) {
    for (int block = 0, left = p->count; block < p->nblock; ++block, left -= p->width) {
        const double *z = p->z + (ptrdiff_t)block * p->nz * p->width;
        for (int column = 0; column < p->width && column < left; ++column) {
            fill_part(b, p, block * p->width + column, z + column, sample);
        }
    }
}

static void fill_ports(const pm_batch *b, const pm_batch_port *p, pm_sample *sample) {
    const pm_scene *scene = b->system->scene;
    for (int lane = 0; lane < p->count; ++lane) {
        const int id = p->id[lane];
        for (int e = 0; e < 2; ++e) {
            const pm_lane_flux *flux = &p->end[e].flux;
            sample->flux[id][e] = (pm_flux){flux->energy[lane], flux->entropy[lane],
                                            flux->energy_gross[lane], flux->entropy_gross[lane]};
            const int part = scene->port[id].subsystem[e];
            sample->evaluated[part] += p->evaluated[lane];
            sample->skipped[part] -= p->evaluated[lane];
        }
    }
}

static void fill_sample(pm_batch *b, pm_sample *sample) {
    for (int i = 0; i < b->npart; ++i) {
        fill_parts(b, &b->part[i], sample);
    }
    for (int i = 0; i < b->nport; ++i) {
        fill_ports(b, &b->port[i], sample);
    }
    clear_fluxes(b);
}

// Counts the subsystems of a group that ended outside their training range. Returns true if a
// subsystem may have to end the run.
static bool note_outside(const pm_batch *b, pm_batch_part *p) {
    uint64_t outside[PM_BATCH_MOST_LANES];
    const int lanes = p->nblock * p->width;
    bool doubtful = pm_lanes_any_not_finite((int64_t)lanes * p->nz, p->z) ||
                    pm_lanes_any_not_finite(lanes, p->E) || pm_lanes_any_not_finite(lanes, p->S);
    for (int block = 0; block < p->nblock; ++block) {
        pm_lanes_outside(p->range, p->width, p->z + (ptrdiff_t)block * p->nz * p->width, outside);
        if (!pm_lanes_any(p->width, outside)) {
            continue;
        }
        doubtful = doubtful || b->system->scene->largest_departure < INFINITY;
        for (int l = 0; l < p->width; ++l) {
            p->outside[block * p->width + l] += outside[l] != 0;
        }
    }
    return doubtful;
}

// Returns the failure of the first subsystem, in the scene's order, whose step has failed.
static pm_status check_all(const pm_batch *b) {
    for (int i = 0; i < b->system->scene->nsubsystem; ++i) {
        PM_TRY(pm_batch_part_check(&b->part[b->part_at[i].group], b->system->scene,
                                   b->part_at[i].lane, b->step + 1));
    }
    return PM_OK;
}

static void mark_changed(pm_batch *b) {
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part *p = &b->part[i];
        for (int l = 0; l < p->nblock * p->width; ++l) {
            p->changed[l] = 1;
        }
    }
    b->exposed = false;
}

pm_status pm_batch_step(pm_batch *batch, pm_sample *sample) {
    pm_batch *b = batch;
    for (int i = 0; i < b->system->scene->substeps; ++i) {
        for (int stage = 0; stage < b->integrator->nstage; ++stage) {
            step_stage(b, stage);
        }
    }
    expose(b);
    bool doubtful = false;
    for (int i = 0; i < b->npart; ++i) {
        doubtful |= note_outside(b, &b->part[i]);
    }
    const pm_status status = doubtful ? check_all(b) : PM_OK;
    const size_t size = (size_t)b->size * sizeof *b->z;
    if (status != PM_OK) {
        memcpy(b->z, b->safe_z, size);
        memcpy(b->stage_z, b->z, size);
        mark_changed(b);
        return status;
    }
    memcpy(b->safe_z, b->z, size);
    ++b->step;
    fill_sample(b, sample);
    return PM_OK;
}

static void clear_counts(pm_batch *b) {
    b->part_calls = b->bulk_calls = b->port_calls = 0;
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part *p = &b->part[i];
        const size_t lanes = (size_t)p->nblock * (size_t)p->width;
        memset(p->evaluated, 0, lanes * sizeof *p->evaluated);
        memset(p->outside, 0, lanes * sizeof *p->outside);
        for (size_t l = 0; l < lanes; ++l) {
            p->renewed[l] = 1; // the bulk term has never been run at this state
        }
    }
    for (int i = 0; i < b->nport; ++i) {
        pm_batch_port *p = &b->port[i];
        const size_t lanes = (size_t)p->nblock * (size_t)p->width;
        memset(p->evaluated, 0, lanes * sizeof *p->evaluated);
        p->known = false;
    }
}

void pm_batch_set_state(pm_batch *batch, const double *z, pm_sample *sample) {
    pm_batch *b = batch;
    const pm_scene *scene = b->system->scene;
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part *p = &b->part[i];
        for (int lane = 0; lane < p->nblock * p->width; ++lane) {
            const int id = p->id[lane < p->count ? lane : p->count - 1];
            double *to = p->z + (ptrdiff_t)(lane / p->width) * p->nz * p->width + lane % p->width;
            for (int c = 0; c < p->nz; ++c) {
                to[(ptrdiff_t)c * p->width] = z[scene->subsystem[id].first + c];
            }
        }
    }
    memcpy(b->stage_z, b->z, (size_t)b->size * sizeof *b->z);
    memcpy(b->safe_z, b->z, (size_t)b->size * sizeof *b->z);
    mark_changed(b);
    expose(b);
    clear_counts(b);
    clear_fluxes(b);
    b->step = 0;
    fill_sample(b, sample);
}
