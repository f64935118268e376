// The subsystems that one process serves, and its exchange with other processes. In each round the
// subsystems expose their port variables, and the process publishes those that other processes need
// as one flux message. When the flux message of every neighbouring process has arrived
// (flux_link.h), all ports are coupled.
#ifndef PM_LOCKSTEP_PROCESS_SUBSYSTEMS_H
#define PM_LOCKSTEP_PROCESS_SUBSYSTEMS_H

#include "lockstep/flux_link.h"
#include "lockstep/resend_buffer.h"
#include "sim/local_subsystems.h"

// The place in the flux messages of what the other side of a remote end (sim/local_subsystems.h)
// shows.
typedef struct pm_process_remote {
    int remote;    // position of the remote end
    int first, ny; // first position and number of its components in y, e and eta
    int end;       // position of its word in `known`
} pm_process_remote;

// The remote ends that lead to one neighbouring process.
typedef struct pm_process_neighbour {
    int count;
    pm_process_remote *remote; // [count]
    bool heard;                // its message of the present round was taken
} pm_process_neighbour;

// The caller owns this storage and initialises it with zeros.
typedef struct pm_process_subsystems {
    int count; // of subsystems
    pm_local_subsystems *local;
    int nlink;
    pm_flux_link *link;              // [nlink], one for each neighbouring process
    pm_process_neighbour *neighbour; // [nlink]
    portmet_flux_t flux;             // the message of the present round
    pm_resend_buffer sent;           // flux messages, by round key (flux_link.h)
    int *ny;                         // [remote ends] components that each end here exposes
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
