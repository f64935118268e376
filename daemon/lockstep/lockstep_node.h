// One process of a distributed run, with its subsystems: a state machine driven by messages and
// time. It computes the steps that the coordinator grants, exchanges one message per round with
// each neighbouring process, and reports every step. Nothing in here blocks; lockstep.h has the
// loops that drive it.
//
// Life: HELLO until a tick opens a session -> report of the initial state -> rounds and reports ->
// END: linger to answer requests -> finished. Whatever it waits for longer than usual it requests
// again, and gives up when the peer stays silent for scene->patience.
//
// Death and return: with a checkpoint a node writes what it must remember every so many steps
// (checkpoint_ring.h). Started again, it goes on from there, and asks its neighbours for the fluxes
// that it missed. Whoever is asked for what it no longer holds goes back to its own checkpoint
// before that, and computes it again: same bits, so that nobody minds getting them twice.
#ifndef PM_LOCKSTEP_LOCKSTEP_NODE_H
#define PM_LOCKSTEP_LOCKSTEP_NODE_H

#include <stdbool.h>

#include "sim/subsystem.h"
#include "transport/drops.h"
#include "transport/transport.h"

typedef struct pm_lockstep_node pm_lockstep_node;

typedef struct pm_lockstep_node_options {
    const double *z; // [scene->nz] where all start; NULL: at the scene's initial state
    int64_t session; // joins only this one; 0: whichever coordinator has the same digest
    const pm_boundary_input
        *boundary_input;    // what the world prescribes; NULL: the scene has no loads
    const char *checkpoint; // file to keep what it must remember, and to go on from; NULL: none
} pm_lockstep_node_options;

// Subscribes and gets ready; says nothing before the first poll. `system` and `transport` must
// outlive it; once it is closed, nobody may wait on the transport any more. `options` may be NULL.
// PM_ECONFIG (a channel's name is too long or means two things), PM_ENET, PM_ENOMEM, and what
// pm_subsystem_open returns.
pm_status pm_lockstep_node_open(pm_lockstep_node **node, const pm_system *system, int process_id,
                                pm_transport *transport, const pm_lockstep_node_options *options);
void pm_lockstep_node_close(pm_lockstep_node *node); // NULL is allowed

// Does what the messages handed out so far (pm_transport_wait) and the time `now` (s, monotonic)
// allow. Returns the time at which to poll again if no message comes before.
double pm_lockstep_node_poll(pm_lockstep_node *node, double now);

// Ends as soon as possible with `code` and `message`; the coordinator is told and ends all others.
void pm_lockstep_node_fail(pm_lockstep_node *node, pm_status code, const char *message);

// The run is over for this node: nothing more to do, or only lingering for others' requests.
bool pm_lockstep_node_finished(const pm_lockstep_node *node);
bool pm_lockstep_node_leaving(const pm_lockstep_node *node);

// PM_OK after END; else the failure, with pm_error() set to its description. PM_ETIMEOUT: a peer
// stayed silent, named; PM_ENET: refused; PM_ENUMERIC: the state became non-finite; the
// coordinator's code after ABORT; PM_EFILE: the checkpoint.
pm_status pm_lockstep_node_result(const pm_lockstep_node *node);

long pm_lockstep_node_step(const pm_lockstep_node *node); // steps completed
pm_transport *pm_lockstep_node_transport(const pm_lockstep_node *node);
const pm_drops *pm_lockstep_node_drops(const pm_lockstep_node *node);

#endif
