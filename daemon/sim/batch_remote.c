// The remote ends of a batch: what it shows there, and the ghosts of the subsystems at the other
// sides. A ghost takes the place of a subsystem in the gathering of inputs of the port laws; the
// rates that the laws give it are not used.
#include <string.h>

#include "sim/batch_parts.h"

static bool is_here(const pm_batch *b, int id) {
    return b->part_at[id].group != PM_BATCH_NOWHERE;
}

// Adds one end of a port of the batch to the remote ends, if it is one, and gives the subsystem at
// the other end a ghost.
static void add_end(pm_batch *b, int end_at) {
    const int port = end_at / 2, end = end_at % 2;
    const int other = b->system->scene->port[port].subsystem[1 - end];
    if (is_here(b, other)) {
        return;
    }
    if (b->remote != NULL) {
        b->remote[b->nremote] = (pm_batch_remote){.port = port, .end = end};
        if (b->part_at[other].lane == PM_BATCH_NOWHERE) {
            b->part_at[other].lane = b->nghost++;
        }
    }
    ++b->nremote;
}

pm_status pm_batch_find_remote(pm_batch *b) {
    const pm_scene *scene = b->system->scene;
    for (int pass = 0; pass < 2; ++pass) {
        const size_t count = (size_t)b->nremote;
        b->nremote = 0;
        if (pass == 1) {
            b->remote = pm_arena_array(&b->arena, count, sizeof *b->remote);
            if (b->remote == NULL) {
                return pm_fail(PM_ENOMEM, "out of memory for %zu remote ends", count);
            }
        }
        for (int i = 0; i < b->count; ++i) {
            for (int k = scene->first_end[b->id[i]]; k < scene->first_end[b->id[i] + 1]; ++k) {
                add_end(b, scene->end_at[k]);
            }
        }
    }
    return PM_OK;
}

void pm_batch_open_remote(pm_batch *b) {
    for (int i = 0; i < b->nremote; ++i) {
        pm_batch_remote *r = &b->remote[i];
        const int *id = b->system->scene->port[r->port].subsystem;
        r->own = pm_batch_address_of(b, id[r->end]);
        r->ghost = pm_batch_address_of(b, id[1 - r->end]);
    }
}

pm_flux pm_batch_show(const pm_batch *b, int end, double *y, double *e, double *eta) {
    const pm_batch_remote *r = &b->remote[end];
    const pm_scene_port *port = &b->system->scene->port[r->port];
    for (int c = 0; c < port->layout[r->end].nz; ++c) {
        const int at = r->own.first + port->component[r->end][c] * r->own.step;
        y[c] = b->stage_z[at];
        e[c] = b->dE[at];
        eta[c] = b->dS[at];
    }
    return r->flux;
}

// Replaces a number. Returns true if it has got other bits.
static bool renew(double *number, double by) {
    const bool renewed = memcmp(number, &by, sizeof by) != 0;
    *number = by;
    return renewed;
}

void pm_batch_hear(pm_batch *b, int end, const pm_port_values *values) {
    const pm_batch_remote *r = &b->remote[end];
    const int *component = b->system->scene->port[r->port].component[1 - r->end];
    for (int c = 0; c < values->ny; ++c) {
        const int at = r->ghost.first + component[c];
        const uint64_t bit = (uint64_t)1 << (component[c] & 63);
        const bool renewed[PM_SHOWN_COUNT] = {renew(&b->ghost_z[at - b->parts_size], values->y[c]),
                                              renew(&b->dE[at], values->e[c]),
                                              renew(&b->dS[at], values->eta[c])};
        b->stage_z[at] = values->y[c];
        for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
            b->renewed[i][r->ghost.lane] |= renewed[i] ? bit : 0;
        }
    }
}

void pm_batch_keep_remote_fluxes(pm_batch *b) {
    for (int i = 0; i < b->nremote; ++i) {
        pm_batch_remote *r = &b->remote[i];
        const pm_batch_place at = b->port_at[r->port];
        r->flux = pm_lane_flux_at(&b->port[at.group].end[r->end].flux, at.lane);
    }
}
