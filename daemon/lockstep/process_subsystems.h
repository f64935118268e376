// The subsystems that one process serves. In each round they expose their port variables, the
// process publishes those that other processes need as one flux message, and every port is coupled
// with what its other end exposes: another subsystem of this process (read through a pointer), a
// neighbouring process (read from its flux message, flux_link.h), or a boundary input.
#ifndef PM_LOCKSTEP_PROCESS_SUBSYSTEMS_H
#define PM_LOCKSTEP_PROCESS_SUBSYSTEMS_H

#include "lockstep/flux_link.h"
#include "lockstep/resend_buffer.h"
#include "sim/subsystem.h"

// A port of one subsystem, and what stands at its other end.
typedef struct pm_process_port {
    bool boundary_input; // the other end is a boundary input, which sends no message
    int peer;            // position in `part` of the subsystem at the other end; -1: it belongs to
                         // another process
    int peer_port;       // position of the port among the peer's ports
    int link;            // if peer is -1: position of the neighbouring process in `link`
    int first, ny;       // if peer is -1: first position and number of the components of the other
                         // end in y, e and eta of the neighbour's flux message
    int end;             // if peer is -1: position of its word in `known` of that message
} pm_process_port;

// A subsystem of the process, with its ports.
typedef struct pm_process_subsystem {
    pm_subsystem *subsystem;
    int nport;
    pm_process_port *port; // [nport]
} pm_process_subsystem;

// The caller owns this storage and initialises it with zeros.
typedef struct pm_process_subsystems {
    int count;
    pm_process_subsystem *part; // [count], in the scene's order
    int nlink;
    pm_flux_link *link;    // [nlink], one for each neighbouring process
    portmet_flux_t flux;   // the message of the present round
    pm_resend_buffer sent; // flux messages, by round key (flux_link.h)
    int part_id, port_id;  // the next port to couple in this round
} pm_process_subsystems;

// Opens the subsystems of process `process_id` at the state z [scene->nz] (NULL: the scene's
// initial state) under `boundary_input` (NULL: the scene has none). Memory comes from the arena;
// system and boundary input must outlive the subsystems. The flux messages of the last `depth`
// rounds are kept for requests. PM_ECONFIG, PM_ENOMEM, and what pm_subsystem_open returns. The
// caller must call pm_process_subsystems_free, also after a failure.
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

// Couples ports, in the scene's order, as far as the neighbours' fluxes of the round `key` have
// arrived. Returns true if all ports are coupled. Sets `used` to true if a flux was used.
bool pm_process_subsystems_couple(pm_process_subsystems *subsystems, int64_t key, bool *used);

// Returns a neighbour whose flux of the round `key` has not arrived; NULL if all have arrived.
const pm_flux_link *pm_process_subsystems_missing(const pm_process_subsystems *subsystems,
                                                  int64_t key);

// Sets the number of substeps of the next step; to be called between two steps.
void pm_process_subsystems_set_substeps(pm_process_subsystems *subsystems, int substeps);

// Returns true after the last round of a step.
bool pm_process_subsystems_complete_step(const pm_process_subsystems *subsystems);

// Ends a round in which all ports are coupled: combines the stages of the Runge-Kutta method.
void pm_process_subsystems_advance(pm_process_subsystems *subsystems);

// Ends a step after its last round. PM_ENUMERIC: a state is not finite.
pm_status pm_process_subsystems_end_step(pm_process_subsystems *subsystems);

// Puts the numbers with which the subsystems continue from the end of a step, with the same bits,
// into the record.
void pm_process_subsystems_record(pm_process_subsystems *subsystems, pm_record *record);

#endif
