// The sums and the worst residuals of a step, group by group.
#include "sim/tally.h"

#include <math.h>

#include "model/port.h"

// W and W/K: one Boltzmann constant per second, for systems in which every flux is rounding.
#define SMALLEST_FLUX 1.380649e-23

#define CLASS_BITS 8
#define MIDDLE 200 // number of the class of ones
#define BLOCK 64   // components whose worst residual is found at a time

int pm_tally_form_of_port(const pm_system *system, int port) {
    const pm_port_model *model = system->port[port];
    return model->law->conservative && model->spec.form == PM_HARD ? PM_TALLY_HARD : PM_TALLY_SOFT;
}

int pm_tally_form_of_subsystem(const pm_system *system, int id) {
    return system->part[id]->spec.form == PM_HARD ? PM_TALLY_HARD : PM_TALLY_SOFT;
}

// --- classes ---

// Returns the number of the class of a flux; 0: it is rounding.
static double class_of(double gross) {
    int exponent;
    if (!(gross > SMALLEST_FLUX)) {
        return 0;
    }
    frexp(gross, &exponent);
    return floor((double)exponent / CLASS_BITS) + MIDDLE;
}

// Makes `top` the largest class of a law, if it is larger than the present one.
static void raise(pm_tally *tally, pm_tally_law law, double top) {
    const double by = tally->top[law] > 0 ? top - tally->top[law] : 0;
    if (top <= tally->top[law]) {
        return;
    }
    for (int form = 0; form < 2; ++form) {
        pm_tally_worst *worst = tally->worst[law][form];
        for (int k = PM_TALLY_CLASSES - 1; k >= 0; --k) {
            worst[k] = k >= by ? worst[k - (int)by] : (pm_tally_worst){0, 0};
        }
    }
    tally->top[law] = top;
}

// Keeps the worse one of two residuals.
static void note(pm_tally_worst *worst, double residual, double place) {
    if (residual > worst->residual || (residual == worst->residual && place < worst->place)) {
        *worst = (pm_tally_worst){residual, place};
    }
}

// --- fluxes ---

// The fluxes of one law at both ends of some components.
typedef struct ends {
    const double *flux[2], *gross[2]; // [1] NULL: there is one end
} ends;

// Notes the worst residuals of `count` components in the classes. `at` receives the block of each,
// where the tally had a smaller one before.
static void find_blocks(const ends *e, bool magnitude, int count, const double *least,
                        double *worst, int *at) {
    for (int i = 0; i < count; i += BLOCK) {
        double found[PM_TALLY_CLASSES];
        pm_lanes_worst(count - i < BLOCK ? count - i : BLOCK, magnitude, e->flux[0] + i,
                       e->flux[1] == NULL ? NULL : e->flux[1] + i, e->gross[0] + i,
                       e->gross[1] == NULL ? NULL : e->gross[1] + i, PM_TALLY_CLASSES, least,
                       found);
        for (int k = 0; k < PM_TALLY_CLASSES; ++k) {
            if (found[k] > worst[k]) {
                worst[k] = found[k];
                at[k] = i;
            }
        }
    }
}

// Returns the first component of a block with this residual.
static int find_component(const ends *e, bool magnitude, int first, double least, double worst) {
    int i = first;
    for (;; ++i) {
        double found;
        pm_lanes_worst(1, magnitude, e->flux[0] + i, e->flux[1] == NULL ? NULL : e->flux[1] + i,
                       e->gross[0] + i, e->gross[1] == NULL ? NULL : e->gross[1] + i, 1, &least,
                       &found);
        if (found == worst) {
            return i;
        }
    }
}

static void add_residuals(pm_tally *tally, pm_tally_law law, int form, int count, int first,
                          const int *id, const ends *e) {
    double top = class_of(pm_lanes_largest(count, e->gross[0]));
    top = e->gross[1] == NULL ? top : fmax(top, class_of(pm_lanes_largest(count, e->gross[1])));
    if (top == 0) {
        return;
    }
    raise(tally, law, top);
    const bool magnitude = law == PM_TALLY_ENERGY;
    double least[PM_TALLY_CLASSES], worst[PM_TALLY_CLASSES] = {0};
    int block[PM_TALLY_CLASSES];
    for (int k = 0; k < PM_TALLY_CLASSES; ++k) {
        // The smallest flux of the class.
        const int number = (int)(tally->top[law] - k);
        least[k] =
            fmax(ldexp(0.5, CLASS_BITS * (number - MIDDLE)), nextafter(SMALLEST_FLUX, INFINITY));
    }
    find_blocks(e, magnitude, count, least, worst, block);
    for (int k = 0; k < PM_TALLY_CLASSES; ++k) {
        pm_tally_worst *kept = &tally->worst[law][form][k];
        if (worst[k] > 0 && worst[k] >= kept->residual) {
            const int i = find_component(e, magnitude, block[k], least[k], worst[k]);
            note(kept, worst[k], first + (id == NULL ? i : id[i]));
        }
    }
}

void pm_tally_add_content(pm_tally *tally, int count, const double *E, const double *S) {
    pm_reproducible_sum_add(&tally->energy, count, E, false);
    pm_reproducible_sum_add(&tally->magnitude, count, E, true);
    pm_reproducible_sum_add(&tally->entropy, count, S, false);
}

void pm_tally_add_fluxes(pm_tally *tally, int form, int count, int first, const int *id,
                         const pm_lane_flux *a, const pm_lane_flux *b) {
    for (pm_tally_law law = 0; law < PM_TALLY_LAWS; ++law) {
        const ends e = law == PM_TALLY_ENERGY
                           ? (ends){{a->energy, b == NULL ? NULL : b->energy},
                                    {a->energy_gross, b == NULL ? NULL : b->energy_gross}}
                           : (ends){{a->entropy, b == NULL ? NULL : b->entropy},
                                    {a->entropy_gross, b == NULL ? NULL : b->entropy_gross}};
        add_residuals(tally, law, form, count, first, id, &e);
    }
    for (int end = 0; end < (b == NULL ? 1 : 2); ++end) {
        const pm_lane_flux *flux = end == 0 ? a : b;
        pm_reproducible_sum_add(&tally->booked, count, flux->energy, false);
        pm_reproducible_sum_add(&tally->gross, count, flux->energy_gross, false);
    }
}

// Notes the steps outside the training range of a subsystem that has left it; the first one of the
// subsystems with most such steps counts.
static void note_outside(pm_tally *tally, double steps, double id) {
    if (steps > tally->worst_steps ||
        (steps == tally->worst_steps && id < tally->worst_subsystem)) {
        tally->worst_steps = steps;
        tally->worst_subsystem = id;
    }
}

void pm_tally_add_counts(pm_tally *tally, int id, long evaluated, long skipped, long outside) {
    tally->evaluated += (double)evaluated;
    tally->skipped += (double)skipped;
    tally->nout_of_range += outside > 0;
    note_outside(tally, (double)outside, id);
}

// --- samples ---

// Room for the fluxes of a block of components.
typedef struct flux_block {
    double number[2][4][BLOCK];
} flux_block;

static pm_lane_flux lanes_of(flux_block *block, int end) {
    double(*n)[BLOCK] = block->number[end];
    return (pm_lane_flux){n[0], n[1], n[2], n[3]};
}

static void put(flux_block *block, int end, int lane, pm_flux flux) {
    double(*n)[BLOCK] = block->number[end];
    n[0][lane] = flux.energy;
    n[1][lane] = flux.entropy;
    n[2][lane] = flux.energy_gross;
    n[3][lane] = flux.entropy_gross;
}

void pm_tally_add_subsystems(pm_tally *tally, const pm_system *system, const pm_sample *sample) {
    const int n = system->scene->physics.nsubsystem;
    flux_block block;
    const pm_lane_flux bulk = lanes_of(&block, 0);
    pm_tally_add_content(tally, n, sample->energy, sample->entropy);
    for (int i = 0, count; i < n; i += count) {
        const int form = pm_tally_form_of_subsystem(system, i);
        for (count = 0; count < BLOCK && i + count < n &&
                        pm_tally_form_of_subsystem(system, i + count) == form;
             ++count) {
            const int id = i + count;
            put(&block, 0, count,
                (pm_flux){sample->bulk_energy[id], sample->bulk_entropy[id],
                          sample->bulk_energy_gross[id], sample->bulk_entropy_gross[id]});
            pm_tally_add_counts(tally, id, sample->evaluated[id], sample->skipped[id],
                                sample->outside[id]);
        }
        pm_tally_add_fluxes(tally, form, count, system->scene->physics.nport + i, NULL, &bulk,
                            NULL);
    }
}

void pm_tally_add_ports(pm_tally *tally, const pm_system *system, const pm_sample *sample,
                        int count, const int *port) {
    flux_block block;
    const pm_lane_flux a = lanes_of(&block, 0), b = lanes_of(&block, 1);
    int id[BLOCK];
    for (int i = 0, used; i < count; i += used) {
        const int form = pm_tally_form_of_port(system, port == NULL ? i : port[i]);
        for (used = 0; used < BLOCK && i + used < count; ++used) {
            id[used] = port == NULL ? i + used : port[i + used];
            if (pm_tally_form_of_port(system, id[used]) != form) {
                break;
            }
            put(&block, 0, used, sample->flux[id[used]][0]);
            put(&block, 1, used, sample->flux[id[used]][1]);
        }
        pm_tally_add_fluxes(tally, form, used, 0, id, &a, &b);
    }
}

// --- several tallies ---

void pm_tally_merge(pm_tally *tally, const pm_tally *other) {
    pm_reproducible_sum_merge(&tally->energy, &other->energy);
    pm_reproducible_sum_merge(&tally->entropy, &other->entropy);
    pm_reproducible_sum_merge(&tally->magnitude, &other->magnitude);
    pm_reproducible_sum_merge(&tally->booked, &other->booked);
    pm_reproducible_sum_merge(&tally->gross, &other->gross);
    for (pm_tally_law law = 0; law < PM_TALLY_LAWS; ++law) {
        raise(tally, law, other->top[law]);
        const int below = (int)(tally->top[law] - other->top[law]);
        for (int k = below; k < PM_TALLY_CLASSES; ++k) {
            for (int form = 0; form < 2; ++form) {
                const pm_tally_worst *worst = &other->worst[law][form][k - below];
                note(&tally->worst[law][form][k], worst->residual, worst->place);
            }
        }
    }
    tally->evaluated += other->evaluated;
    tally->skipped += other->skipped;
    tally->nout_of_range += other->nout_of_range;
    note_outside(tally, other->worst_steps, other->worst_subsystem);
}

pm_tally_worst pm_tally_worst_of(const pm_tally *tally, pm_tally_law law, int form) {
    return tally->worst[law][form][PM_TALLY_CLASSES - 1];
}
