// A port's outgoing and incoming fluxes.
#include "net/flux_link.h"

#include "net/channel.h"

// The neighbour may ask for the round it is in, which is ours or the one before.
#define SENT_DEPTH 2

static pm_status make_flux(pm_arena *arena, portmet_flux_t *flux, int ny) {
    double *memory = pm_arena_array(arena, 3 * (size_t)ny, sizeof(double));
    if (memory == NULL) {
        return pm_fail(PM_ENOMEM, "flux of %d numbers: out of memory", ny);
    }
    *flux = (portmet_flux_t){.ny = ny, .y = memory, .e = memory + ny, .eta = memory + 2 * ny};
    return PM_OK;
}

pm_status pm_flux_link_init(pm_flux_link *link, pm_arena *arena, const pm_scene *scene, int port_id,
                            pm_end own) {
    const pm_end other = own == PM_END_A ? PM_END_B : PM_END_A;
    const pm_scene_port *port = &scene->port[port_id];
    link->neighbour = scene->subsystem[port->subsystem[other]].name;
    PM_TRY(pm_channel_flux(link->channel, scene, port_id, other));
    PM_TRY(pm_channel_flux(link->sent.channel, scene, port_id, own));
    const portmet_flux_t shape = {.ny = port->layout[own].nz};
    PM_TRY(pm_outbox_init(&link->sent, arena, SENT_DEPTH, pm_flux_size(&shape)));
    PM_TRY(make_flux(arena, &link->scratch, port->layout[other].nz));
    for (int i = 0; i < PM_INBOX_DEPTH; ++i) {
        PM_TRY(make_flux(arena, &link->inbox[i], port->layout[other].nz));
        link->inbox_key[i] = -1;
    }
    return PM_OK;
}

pm_status pm_flux_link_send(pm_flux_link *link, pm_transport *transport, int64_t key,
                            const portmet_flux_t *head, const pm_port_values *shown) {
    portmet_flux_t message = *head;
    message.ny = shown->ny;
    message.y = (double *)shown->y;
    message.e = (double *)shown->e;
    message.eta = (double *)shown->eta;
    unsigned char *data = pm_outbox_data(&link->sent, key);
    const size_t size = pm_flux_encode(&message, data, link->sent.capacity);
    if (size == 0) {
        return pm_fail(PM_ENUMERIC, "channel %s: not finite in round %d of step %lld",
                       link->sent.channel, message.round, (long long)message.step);
    }
    return pm_outbox_publish(&link->sent, transport, key, size);
}

pm_drop pm_flux_link_keep(pm_flux_link *link, int64_t key, int64_t present) {
    const int slot = (int)(key % PM_INBOX_DEPTH);
    if (key < present || link->inbox_key[slot] == key) {
        return PM_DROP_REPEATED;
    }
    if (key > present + 1) {
        return PM_DROP_RANGE;
    }
    // The inbox takes the decoded arrays and leaves its own for the next message.
    const portmet_flux_t unused = link->inbox[slot];
    link->inbox[slot] = link->scratch;
    link->inbox_key[slot] = key;
    link->scratch = unused;
    return PM_KEEP;
}

bool pm_flux_link_take(const pm_flux_link *link, int64_t key, pm_port_values *neighbour) {
    const int slot = (int)(key % PM_INBOX_DEPTH);
    if (link->inbox_key[slot] != key) {
        return false;
    }
    const portmet_flux_t *flux = &link->inbox[slot];
    *neighbour = (pm_port_values){flux->ny, flux->y, flux->e, flux->eta, NULL};
    return true;
}
