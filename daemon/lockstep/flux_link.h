// A flux link keeps the fluxes of one neighbouring process until the round that needs them. This
// file also defines the array sizes of a process's flux message. The key of a round is its number
// counted from the start of the run: step * (most rounds of a step) + round. A step may have fewer
// rounds (sim/iteration.h).
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
    struct pm_lockstep_node *node;        // context of the message handler
    int process_id;                       // index of the neighbour among the scene's processes
    const char *neighbour;                // the neighbour's name, borrowed from the scene
    char channel[PM_CHANNEL_SIZE];        // on which the neighbour publishes its fluxes
    char address[PM_CHANNEL_SIZE];        // on which the neighbour receives requests
    portmet_flux_t scratch;               // the message being decoded
    portmet_flux_t inbox[PM_INBOX_DEPTH]; // the messages that are kept
    int64_t inbox_key[PM_INBOX_DEPTH];    // the rounds of these messages; -1: empty
    pm_request_filter requests;           // requests of the neighbour for fluxes of this process
} pm_flux_link;

// Sets the neighbour and its channels, and allocates arrays for the messages of process
// `process_id` in the arena. The caller has set link->node. `scene` must outlive the link.
// PM_ECONFIG: a channel's name is too long; PM_ENOMEM.
pm_status pm_flux_link_init(pm_flux_link *link, pm_arena *arena, const pm_scene *scene,
                            int process_id);

// Stores the message decoded into link->scratch, which belongs to the round with the key `key`, in
// the inbox. `present` is the key of the round that this process computes, and `next_step` that of
// the first round of the next step, which may come next. PM_KEEP: the message is stored, and
// link->scratch has other arrays for the next message. PM_DROP_REPEATED: the inbox holds the same
// message already, or the round is over. PM_DROP_CONFLICT: the inbox holds a message of this round
// with other bits. PM_DROP_RANGE: `key` is more than one round ahead of `present`, which the
// neighbour cannot be. A message that is not stored stays in link->scratch.
pm_drop pm_flux_link_keep(pm_flux_link *link, int64_t key, int64_t present, int64_t next_step);

// Returns the neighbour's message of the round with the key `key`; NULL if it has not arrived or is
// no longer kept. The link owns the message, which is valid until a message of a later round takes
// its place.
const portmet_flux_t *pm_flux_link_take(const pm_flux_link *link, int64_t key);

// --- the shape of a process's flux message ---

// Sets *flux to a message of process `process_id` with nend, ny, nresponse and nknown as its
// subsystems need them, arrays of these lengths in the arena, and zeros elsewhere. nend counts the
// ends of ports between two processes, ny the components that these ends expose. nresponse is ny
// and nknown is nend for a discrete integrator; both are 0 for all others. PM_ENOMEM.
pm_status pm_flux_message_alloc(portmet_flux_t *flux, pm_arena *arena, const pm_scene *scene,
                                int process_id);

// The place of one end of a port in the flux messages of its process. The ends are ordered by
// subsystem, then by port, as in the scene.
typedef struct pm_flux_place {
    const pm_scene *scene; // borrowed
    int process_id;
    int end_at;          // 2 * position of the port in the scene + end
    int position;        // index of the end in the arrays energy_flux, entropy_flux and known
    int first, ny;       // first index and number of its components in y, e, eta and response
    int subsystem, next; // where to look for the next end: subsystem of the process, end of a port
} pm_flux_place;

// Returns a place before the first end. pm_flux_place_next goes to the next end; it returns false
// if there is none, and `position` and `first` are then the numbers of ends and of components.
pm_flux_place pm_flux_place_begin(const pm_scene *scene, int process_id);
bool pm_flux_place_next(pm_flux_place *place);

#endif
