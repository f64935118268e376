// The subsystems that one process serves, and its exchange with other processes. In each round the
// subsystems expose their port variables, and the process publishes those that other processes need
// as one flux message. When the flux message of every neighbouring process has arrived,
// all ports are coupled.
//
// The key of a round is its number counted from the start of the run: step * (most rounds of a
// step) + round. A step may have fewer rounds (sim/iteration.h).
#ifndef PM_LOCKSTEP_PROCESS_SUBSYSTEMS_H
#define PM_LOCKSTEP_PROCESS_SUBSYSTEMS_H

#include "lockstep/codec.h"
#include "lockstep/resend_buffer.h"
#include "sim/local_subsystems.h"

// --- the fluxes of a neighbour ---

// The number of rounds whose fluxes are kept. A neighbour is at most one round ahead, since it
// needs this process's flux of a round to finish the round.
#define PM_INBOX_DEPTH 2

// The place in the flux messages of what the other side of a remote end (sim/local_subsystems.h)
// shows.
typedef struct pm_process_remote {
    int remote;    // position of the remote end
    int first, ny; // first position and number of its components in y, e and eta
    int end;       // position of its word in `known`
} pm_process_remote;

// A flux link keeps the fluxes of one neighbouring process until the round that needs them.
typedef struct pm_flux_link {
    struct pm_lockstep_node *node; // context of the message handler
    int count;
    pm_process_remote *remote;            // [count] the remote ends that lead to this neighbour
    bool heard;                           // its message of the present round was taken
    int process_id;                       // index of the neighbour among the scene's processes
    const char *neighbour;                // the neighbour's name, borrowed from the scene
    char channel[PM_CHANNEL_SIZE];        // on which the neighbour publishes its fluxes
    char address[PM_CHANNEL_SIZE];        // on which the neighbour receives requests
    portmet_flux_t scratch;               // the message being decoded
    portmet_flux_t inbox[PM_INBOX_DEPTH]; // the messages that are kept
    int64_t inbox_key[PM_INBOX_DEPTH];    // the rounds of these messages; -1: empty
} pm_flux_link;

// Stores the message decoded into link->scratch, which belongs to the round with the key `key`, in
// the inbox. `present` is the key of the round that this process computes, and `next_step` that of
// the first round of the next step, which may come next. PM_KEEP: the message is stored, and
// link->scratch has other arrays for the next message. PM_DROP_REPEATED: the inbox holds the same
// message already, or the round is over. PM_DROP_CONFLICT: the inbox holds a message of this round
// with other bits. PM_DROP_RANGE: `key` is more than one round ahead of `present`, which the
// neighbour cannot be. A message that is not stored stays in link->scratch.
pm_drop pm_flux_link_keep(pm_flux_link *link, int64_t key, int64_t present, int64_t next_step);

// Sets *flux to a message of process `process_id` with nend, ny, nresponse and nknown as its
// subsystems need them, arrays of these lengths in the arena, and zeros elsewhere. nend counts the
// ends of ports between two processes, ny the components that these ends expose. nresponse is ny
// and nknown is nend for a discrete integrator; both are 0 for all others. PM_ENOMEM.
pm_status pm_flux_message_alloc(portmet_flux_t *flux, pm_arena *arena, const pm_scene *scene,
                                int process_id);

// --- the subsystems ---

// The caller owns this storage and initialises it with zeros.
typedef struct pm_process_subsystems {
    int count; // of subsystems
    pm_local_subsystems *local;
    int nlink;
    pm_flux_link *link;    // [nlink], one for each neighbouring process
    portmet_flux_t flux;   // the message of the present round
    pm_resend_buffer sent; // flux messages, by round key
    int *ny;               // [remote ends] components that each end here exposes
} pm_process_subsystems;

// Opens the subsystems of process `process_id` at the state z [scene->nz] (NULL: the scene's
// initial state) under `boundary_input` (NULL: the scene has none). Memory comes from the arena;
// system and boundary input must outlive the subsystems. The flux messages of the last `depth`
// rounds are kept for requests. PM_ECONFIG, PM_ENOMEM, and what pm_local_subsystems_open returns.
// The caller must call pm_process_subsystems_free, also after a failure.
pm_status pm_process_subsystems_init(pm_process_subsystems *subsystems, pm_arena *arena,
                                     const pm_system *system, int process_id, const double *z,
                                     const pm_boundary_input *boundary_input, int depth);
void pm_process_subsystems_free(pm_process_subsystems *subsystems);

// Begins the round `key`: exposes port variables, publishes the flux message (`head` gives its
// session, step, round and time), and computes the bulk terms while the neighbours' messages
// travel. PM_ENUMERIC: a value to be published is not finite; PM_ENET.
pm_status pm_process_subsystems_start_round(pm_process_subsystems *subsystems,
                                            pm_transport *transport, int64_t key,
                                            const portmet_flux_t *head);

// Takes the neighbours' fluxes of the round `key` that have arrived, and couples all ports once the
// last one has. Returns true if the ports are coupled. Sets `used` to true if a flux was taken.
bool pm_process_subsystems_couple(pm_process_subsystems *subsystems, int64_t key, bool *used);

// Returns a neighbour whose flux of the round `key` has not arrived; NULL if all have arrived.
const pm_flux_link *pm_process_subsystems_missing(const pm_process_subsystems *subsystems,
                                                  int64_t key);

// Ends a round in which all ports are coupled, and, after the last round of a step, the step.
// `complete` tells whether this was the last round. PM_ENUMERIC: a state is not finite.
pm_status pm_process_subsystems_end_round(pm_process_subsystems *subsystems, bool *complete);

#endif
