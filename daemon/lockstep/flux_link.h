// What one process hears from another: the neighbour's fluxes, kept until their round comes. And
// the shape of a process's flux message.
#ifndef PM_LOCKSTEP_FLUX_LINK_H
#define PM_LOCKSTEP_FLUX_LINK_H

#include "base/arena.h"
#include "lockstep/codec.h"
#include "lockstep/request_filter.h"
#include "model/port.h"
#include "scene/scene.h"
#include "transport/transport.h"

// A neighbour is at most one round ahead: it needs our flux of a round to finish it.
#define PM_INBOX_DEPTH 2

// Storage the caller owns. Rounds are counted from the start of the run ("key").
typedef struct pm_flux_link {
    struct pm_lockstep_node *node; // whose it is
    int process_id;                // the neighbour
    const char *neighbour;         // its name
    char channel[PM_CHANNEL_SIZE]; // of its fluxes
    char address[PM_CHANNEL_SIZE]; // of requests to it
    portmet_flux_t scratch;        // being decoded
    portmet_flux_t inbox[PM_INBOX_DEPTH];
    int64_t inbox_key[PM_INBOX_DEPTH]; // -1: empty
    pm_request_filter asked;           // by the neighbour, for fluxes
} pm_flux_link;

// Name, shape and memory (from the arena) for the messages of process `process_id`. PM_ECONFIG,
// PM_ENOMEM.
pm_status pm_flux_link_init(pm_flux_link *link, pm_arena *arena, const pm_scene *scene,
                            int process_id);

// Keeps the message in `scratch`, which is of round `key`, unless round `present` no longer needs
// it or cannot have led to it.
pm_drop pm_flux_link_keep(pm_flux_link *link, int64_t key, int64_t present);

// The neighbour's message of round `key`; NULL if that has not arrived.
const portmet_flux_t *pm_flux_link_take(const pm_flux_link *link, int64_t key);

// --- the shape of a process's flux message ---

// Sets nend and ny, and makes arrays of these lengths in the arena. PM_ENOMEM.
pm_status pm_flux_make(portmet_flux_t *flux, pm_arena *arena, const pm_scene *scene,
                       int process_id);

// Where the components that a port shows at this end, which leaves its process, begin in the arrays
// y, e and eta of that process's messages.
int pm_flux_first(const pm_scene *scene, int port_id, pm_end end);

#endif
