// A flux link keeps the fluxes of one neighbouring process until the round that needs them. This
// file also defines the array sizes of a process's flux message. The key of a round is its number
// counted from the start of the run: step * (most rounds of a step) + round.
#ifndef PM_LOCKSTEP_FLUX_LINK_H
#define PM_LOCKSTEP_FLUX_LINK_H

#include "base/arena.h"
#include "lockstep/codec.h"
#include "lockstep/request_filter.h"
#include "model/port.h"
#include "scene/scene.h"
#include "transport/transport.h"

// The number of rounds whose fluxes are kept. A neighbour is at most one round ahead, since it
// needs this process's flux of a round to finish the round.
#define PM_INBOX_DEPTH 2

// The caller owns this storage.
typedef struct pm_flux_link {
    struct pm_lockstep_node *node; // context of the message handler
    int process_id;                // the neighbour
    const char *neighbour;         // its name
    char channel[PM_CHANNEL_SIZE]; // of its fluxes
    char address[PM_CHANNEL_SIZE]; // of requests to it
    portmet_flux_t scratch;        // the message being decoded
    portmet_flux_t inbox[PM_INBOX_DEPTH];
    int64_t inbox_key[PM_INBOX_DEPTH]; // -1: empty
    pm_request_filter requests;        // of the neighbour, for fluxes
} pm_flux_link;

// Sets the channel names and allocates arrays for the messages of process `process_id` in the
// arena. PM_ECONFIG, PM_ENOMEM.
pm_status pm_flux_link_init(pm_flux_link *link, pm_arena *arena, const pm_scene *scene,
                            int process_id);

// Keeps the message in `scratch`, which is of the round `key`. PM_DROP_REPEATED: it is kept
// already, or the round is over; PM_DROP_CONFLICT: one with other bits is kept already;
// PM_DROP_RANGE: no neighbour can be there while this process computes the round `present`.
pm_drop pm_flux_link_keep(pm_flux_link *link, int64_t key, int64_t present);

// Returns the neighbour's message of the round `key`, which the link owns; NULL if it has not
// arrived.
const portmet_flux_t *pm_flux_link_take(const pm_flux_link *link, int64_t key);

// --- the shape of a process's flux message ---

// Sets nend, ny and nresponse for a process, and allocates arrays of these lengths in the arena.
// PM_ENOMEM.
pm_status pm_flux_message_alloc(portmet_flux_t *flux, pm_arena *arena, const pm_scene *scene,
                                int process_id);

// Returns the index at which the components of one end of a port begin in the arrays y, e and eta
// of its process's messages. The other end of the port must belong to another process.
int pm_flux_message_offset(const pm_scene *scene, int port_id, pm_end end);

#endif
