// The numbers with which a batch goes on from the end of a step with the same bits: the states, the
// counts, which numbers were renewed at the last exposure, the projections of a balanced
// integrator, and what the ghosts and remote ends have shown. Co-energies, potentials and rates
// follow from these.
#include <string.h>

#include "sim/batch_parts.h"

// Puts 64 bits as two whole numbers, which a double holds exactly.
static void put_bits(pm_record *record, const char *name, uint64_t *bits) {
    long low = (long)(*bits & UINT32_MAX), high = (long)(*bits >> 32);
    pm_record_put_long(record, name, &low);
    pm_record_put_long(record, name, &high);
    *bits = (uint64_t)low | (uint64_t)high << 32;
}

static void put_states(pm_batch *b, pm_record *record) {
    for (int i = 0; i < b->count; ++i) {
        const pm_batch_address at = pm_batch_address_of(b, b->id[i]);
        const int nz = b->system->scene->subsystem[b->id[i]].layout.nz;
        for (int c = 0; c < nz; ++c) {
            pm_record_put(record, "z", &b->z[at.first + c * at.step], 1);
        }
    }
}

static void put_renewed(pm_batch *b, pm_record *record, int64_t lane) {
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        put_bits(record, "renewed", &b->renewed[i][lane]);
    }
}

static void put_counts(pm_batch *b, pm_record *record) {
    pm_record_put_long(record, "step", &b->step);
    pm_record_put_long(record, "exposures", &b->part_calls);
    pm_record_put_long(record, "bulk terms", &b->bulk_calls);
    pm_record_put_long(record, "laws", &b->port_calls);
    for (int i = 0; i < b->npart; ++i) {
        pm_batch_part *p = &b->part[i];
        for (int lane = 0; lane < p->count; ++lane) {
            pm_record_put_long(record, "rested", &p->rested[lane]);
            pm_record_put_long(record, "outside", &p->outside[lane]);
            put_renewed(b, record, p->first_lane + lane);
        }
    }
    for (int i = 0; i < b->nport; ++i) {
        for (int lane = 0; lane < b->port[i].count; ++lane) {
            pm_record_put_long(record, "rested", &b->port[i].rested[lane]);
        }
    }
}

// A part whose integrator is not balanced has no projections.
static void put_projections(const pm_batch_part *p, pm_record *record) {
    for (int lane = 0; lane < p->count && p->projection != NULL; ++lane) {
        pm_record_put(record, "projected energy", &p->projection[lane].energy, 1);
        pm_record_put(record, "projected entropy", &p->projection[lane].entropy, 1);
        pm_record_put_long(record, "exposures again", &p->again[lane]);
    }
}

static void put_remote(pm_batch *b, pm_record *record) {
    const int count = (int)(b->size - b->parts_size);
    pm_record_put(record, "ghost z", b->ghost_z, count);
    pm_record_put(record, "ghost dE", b->dE + b->parts_size, count);
    pm_record_put(record, "ghost dS", b->dS + b->parts_size, count);
    for (int64_t lane = b->parts_lanes; lane < b->lanes; ++lane) {
        put_renewed(b, record, lane);
    }
    for (int i = 0; i < b->nremote; ++i) {
        pm_record_put(record, "energy flux", &b->remote[i].flux.energy, 1);
        pm_record_put(record, "entropy flux", &b->remote[i].flux.entropy, 1);
    }
}

void pm_batch_record(pm_batch *b, pm_record *record) {
    if (pm_record_restores(record)) {
        b->z = b->safe_z = b->state[0];
    }
    put_states(b, record);
    if (pm_record_restores(record)) {
        pm_batch_expose_anew(b);
        pm_batch_clear(b);
    }
    put_counts(b, record);
    for (int i = 0; i < b->npart; ++i) {
        put_projections(&b->part[i], record);
        pm_batch_substep_keep(&b->part[i]);
    }
    put_remote(b, record);
}
