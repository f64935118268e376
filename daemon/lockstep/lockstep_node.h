// A node: one process of a distributed run, with its subsystems. It is a state machine driven by
// messages and time (node.h has its table of states). It computes the steps that the coordinator
// grants, exchanges one flux message per round with each neighbouring process, and reports every
// step. No function blocks; lockstep.h has the loops that drive it.
//
// Life cycle: a node publishes hellos until a tick opens a session, reports its initial state, and
// computes rounds and reports steps until END. It then answers requests for a short time and is
// finished. If a message takes longer than usual, the node requests it (waiting.h). The node fails
// if the coordinator is silent for longer than the scene's patience.
//
// Death and return: with a checkpoint, a node saves its state at regular steps (checkpoint_ring.h).
// After a restart it continues from there and requests the fluxes that it missed. If another
// process requests a message that the node no longer holds, the node rolls back to its own
// checkpoint and recomputes the message, with the same bits. Receivers drop messages that they have
// already.
#ifndef PM_LOCKSTEP_LOCKSTEP_NODE_H
#define PM_LOCKSTEP_LOCKSTEP_NODE_H

#include <stdbool.h>

#include "sim/subsystem.h"
#include "transport/drops.h"
#include "transport/transport.h"

typedef struct pm_lockstep_node pm_lockstep_node;

typedef struct pm_lockstep_node_options {
    const double *z; // [scene->nz] initial state of the whole scene; NULL: as the scene says
    int64_t session; // the only session to join; 0: any open session with the node's digest
    const pm_boundary_input *boundary_input; // NULL: the scene has none
    double *live;           // [scene->nlive] where the node writes the values of live inputs, for
                            // boundary_input->live; NULL only if the scene has none
    const char *checkpoint; // file to save checkpoints in and to continue from; NULL: none
    // Called about once a second, with the number of steps computed, so that others see that the
    // node is alive. May be NULL.
    void (*alive)(void *context, int64_t step);
    void *context; // of `alive`
} pm_lockstep_node_options;

// Opens the subsystems of process `process_id` and subscribes to the channels of the node; it
// publishes nothing before the first poll. `system`, `transport` and the data that `options` (may
// be NULL) points to must outlive the node. Nobody may wait on the transport after the node is
// closed. PM_ECONFIG: a channel's name is too long or has two meanings; PM_ENET, PM_ENOMEM, and
// what pm_subsystem_open returns.
pm_status pm_lockstep_node_open(pm_lockstep_node **node, const pm_system *system, int process_id,
                                pm_transport *transport, const pm_lockstep_node_options *options);
void pm_lockstep_node_close(pm_lockstep_node *node); // NULL is allowed

// Advances the node as far as it can at the time `clock` (s, monotonic) with the messages that
// pm_transport_wait has delivered so far. Returns the time at which to poll again if no message
// comes before. The caller polls several times in PM_PRESENCE_LONGEST. Any time beyond
// PM_PRESENCE_LONGEST between two polls counts as an absence of this process (base/presence.h), and
// not as the silence of others.
double pm_lockstep_node_poll(pm_lockstep_node *node, double clock);

// Notes that the caller is about to wait, at the time `clock` (s, monotonic). Without such calls
// the vitals of the node (vitals.h) do not contain the times that it waits for each peer.
void pm_lockstep_node_rest(pm_lockstep_node *node, double clock);

// Ends the node with `code` and `message`. The node reports them to the coordinator, which ends the
// other nodes. Does nothing if the node is ending already.
void pm_lockstep_node_fail(pm_lockstep_node *node, pm_status code, const char *message);

// _finished returns true if the node has nothing left to do. _leaving returns true if the run is
// over for this node, which only answers requests of others.
bool pm_lockstep_node_finished(const pm_lockstep_node *node);
bool pm_lockstep_node_leaving(const pm_lockstep_node *node);

// Returns PM_OK after END; otherwise the failure, with pm_error() set to its description.
// PM_ETIMEOUT: the coordinator stayed silent; PM_ENET: this node was refused, or the transport
// failed; PM_ENUMERIC: the state became non-finite; PM_EFILE: the checkpoint; after ABORT the
// coordinator's code.
pm_status pm_lockstep_node_result(const pm_lockstep_node *node);

// These functions return the transport that the node was opened on, and the counts of used and
// dropped messages, which the node owns.
pm_transport *pm_lockstep_node_transport(const pm_lockstep_node *node);
const pm_drops *pm_lockstep_node_drops(const pm_lockstep_node *node);

#endif
