// Sums up the last step of a batch for the ledger, group by group.
#include "sim/batch_parts.h"

// Returns the sum over the lanes of a group; 0 if there is no array.
static long sum_of(int count, const long *number) {
    long sum = 0;
    for (int l = 0; l < count && number != NULL; ++l) {
        sum += number[l];
    }
    return sum;
}

static void add_counts(pm_tally *tally, long calls, long evaluated) {
    tally->evaluated += (double)evaluated;
    tally->skipped += (double)(calls - evaluated);
}

static void add_part(const pm_batch *b, const pm_batch_part *p, pm_tally *tally) {
    const long count = p->count, bulk_calls = p->bulk_term == NULL ? 0 : b->bulk_calls;
    const long exposures = count * b->part_calls + sum_of(p->count, p->again);
    pm_tally_add_content(tally, p->count, p->E, p->S);
    pm_tally_add_fluxes(tally, pm_tally_form_of_subsystem(b->system, p->id[0]), p->count,
                        b->system->scene->nport, p->id, &p->bulk, NULL);
    add_counts(tally, exposures + count * b->bulk_calls,
               exposures + count * bulk_calls - sum_of(p->count, p->rested));
    if (sum_of(p->count, p->outside) > 0) {
        for (int l = 0; l < p->count; ++l) {
            pm_tally_add_counts(tally, p->id[l], 0, 0, p->outside[l]);
        }
    }
}

// A port counts for each subsystem at its ends.
static void add_port(const pm_batch *b, const pm_batch_port *p, pm_tally *tally) {
    const long calls = 2 * p->count * b->port_calls;
    pm_tally_add_fluxes(tally, pm_tally_form_of_port(b->system, p->id[0]), p->count, 0, p->id,
                        &p->end[0].flux, &p->end[1].flux);
    add_counts(tally, calls, calls - 2 * sum_of(p->count, p->rested));
}

// Sets the flux of a lane.
static void set_flux(const pm_lane_flux *flux, int lane, pm_flux to) {
    flux->energy[lane] = to.energy;
    flux->entropy[lane] = to.entropy;
    flux->energy_gross[lane] = to.energy_gross;
    flux->entropy_gross[lane] = to.entropy_gross;
}

// Exchanges the fluxes of a port to another process for those in `flux`, and takes back what its
// other end counts if `hides` is true.
static void exchange(const pm_batch *b, const pm_batch_remote *r, bool hides, pm_flux flux[2],
                     pm_tally *tally) {
    const pm_batch_place at = b->port_at[r->port];
    pm_batch_port *p = &b->port[at.group];
    for (int end = 0; end < 2; ++end) {
        const pm_flux now = pm_lane_flux_at(&p->end[end].flux, at.lane);
        set_flux(&p->end[end].flux, at.lane, flux[end]);
        flux[end] = now;
    }
    if (hides) {
        add_counts(tally, -b->port_calls, p->rested[at.lane] - b->port_calls);
    }
}

void pm_batch_tally(pm_batch *b, pm_tally *tally) {
    for (int i = 0; i < b->nremote; ++i) {
        pm_flux *hidden = b->remote[i].hidden;
        hidden[0] = hidden[1] = (pm_flux){0};
        exchange(b, &b->remote[i], true, hidden, tally);
    }
    for (int i = 0; i < b->npart; ++i) {
        add_part(b, &b->part[i], tally);
    }
    for (int i = 0; i < b->nport; ++i) {
        add_port(b, &b->port[i], tally);
    }
    for (int i = 0; i < b->nremote; ++i) {
        exchange(b, &b->remote[i], false, b->remote[i].hidden, tally);
    }
}
