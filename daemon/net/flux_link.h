// One of a node's ports on the wire: the fluxes it sends, kept for requests, and the neighbour's,
// kept until their round comes.
#ifndef PM_NET_FLUX_LINK_H
#define PM_NET_FLUX_LINK_H

#include "net/codec.h"
#include "net/outbox.h"
#include "sim/subsystem.h"

// A neighbour is at most one round ahead: it needs our flux of a round to finish it.
#define PM_INBOX_DEPTH 2

// Storage the caller owns. Rounds are counted from the start of the run ("key").
typedef struct pm_flux_link {
    struct pm_lockstep_node *node; // whose it is
    int port;                      // of the subsystem
    const char *neighbour;         // name
    char channel[PM_CHANNEL_SIZE]; // of the neighbour's fluxes
    pm_outbox sent;                // own fluxes
    portmet_flux_t scratch;        // being decoded
    portmet_flux_t inbox[PM_INBOX_DEPTH];
    int64_t inbox_key[PM_INBOX_DEPTH]; // -1: empty
    bool alive;                        // the neighbour was heard of since the last poll
    double heard;                      // s, when
} pm_flux_link;

// Names, shapes and memory (from the arena) of the end `own` of a port between two subsystems.
// PM_ECONFIG, PM_ENOMEM.
pm_status pm_flux_link_init(pm_flux_link *link, pm_arena *arena, const pm_scene *scene, int port_id,
                            pm_end own);

// Publishes what this end shows. `head` has all of the message but ny, y, e and eta. PM_ENUMERIC:
// not finite.
pm_status pm_flux_link_send(pm_flux_link *link, pm_transport *transport, int64_t key,
                            const portmet_flux_t *head, const pm_port_values *shown);

// Keeps the message in `scratch`, which is of round `key`, unless round `present` no longer needs
// it or cannot have led to it.
pm_drop pm_flux_link_keep(pm_flux_link *link, int64_t key, int64_t present);

// What the neighbour shows in round `key`; false if that has not arrived.
bool pm_flux_link_take(const pm_flux_link *link, int64_t key, pm_port_values *neighbour);

#endif
