// A node: one process of a distributed run, with its subsystems. It is a state machine driven by
// messages and time (node.c has its table of states). It computes the steps that the coordinator
// grants, exchanges one flux message per round with each neighbouring process, and reports every
// step. No function blocks; pm_lockstep_run_node drives it.
//
// Life cycle: a node publishes hellos until a tick opens a session, reports its initial state, and
// computes rounds and reports steps until END. It then answers requests for a short time and is
// finished. If a message takes longer than usual, the node requests it (endpoint.h). The node fails
// if the coordinator is silent for longer than the scene's patience.
//
// Several runs: a coordinator that stays begins one run after another; its ticks take the node to
// the start of the next one. A node that stays also outlives its coordinator, and runs that have
// failed.
//
// Death and return: with a checkpoint, a node saves its state at regular steps.
// After a restart it continues from there and requests the fluxes that it missed. If another
// process requests a message that the node no longer holds, the node rolls back to its own
// checkpoint and recomputes the message, with the same bits. Receivers drop messages that they have
// already.
#ifndef PM_LOCKSTEP_NODE_H
#define PM_LOCKSTEP_NODE_H

#include "lockstep/endpoint.h"
#include "lockstep/health.h"
#include "lockstep/reports.h"
#include "store/snapshot.h"

typedef struct pm_lockstep_node pm_lockstep_node;

typedef struct pm_lockstep_node_options {
    const double *z; // [scene->nz] initial state of the whole scene; NULL: as the scene says
    int64_t session; // the only session to join; 0: any open session with the node's digest
    const pm_boundary_input *boundary_input; // NULL: the scene has none
    double *live; // [scene->nlive] where the node writes the values of live inputs, for
                  // boundary_input->live; NULL only if the scene has none
    bool stays; // after a run, and after a failure that is not its own, it waits for the next one,
                // as long as it takes
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
// the vitals of the node (health.h) do not contain the times that it waits for each peer.
void pm_lockstep_node_begin_wait(pm_lockstep_node *node, double clock);

// Ends the node with `code` and `message`. The node reports them to the coordinator, which ends the
// other nodes. Does nothing if the node is ending already.
void pm_lockstep_node_fail(pm_lockstep_node *node, pm_status code, const char *message);

// Returns true if the node has nothing left to do.
bool pm_lockstep_node_finished(const pm_lockstep_node *node);

// Returns PM_OK after END; otherwise the failure, with pm_error() set to its description.
// PM_ETIMEOUT: the coordinator stayed silent; PM_ENET: this node was refused, or the transport
// failed; PM_ENUMERIC: the state became non-finite; PM_EFILE: the checkpoint; after ABORT the
// coordinator's code.
pm_status pm_lockstep_node_result(const pm_lockstep_node *node);

// Returns the counts of used and dropped messages, which the node owns.
const pm_drops *pm_lockstep_node_drops(const pm_lockstep_node *node);

// Drives a node until the run is over, and returns its result. When `*stop` becomes non-zero, the
// run ends with PM_EINTERRUPTED within about 0.1 s, and the other processes are told. `stop` may be
// NULL.
pm_status pm_lockstep_run_node(pm_lockstep_node *node, const volatile sig_atomic_t *stop);

// --- the inside of a node, for node.c and for tests ---

typedef enum pm_node_phase {
    PM_NODE_HELLO,
    PM_NODE_RUNNING,
    PM_NODE_FAILING,
    PM_NODE_LEAVING,
    PM_NODE_FINISHED
} pm_node_phase;

// The checkpoints of a process: the state of its subsystems at the last two multiples of `interval`
// steps, in memory and in one file. A process that is restarted after its death continues from the
// newer one. A process that is asked for the message of a step that it no longer holds rolls back
// to its newest checkpoint before that step. No process is ever ahead of another by more than an
// interval less one step, so all of them hold a common checkpoint.
typedef struct pm_checkpoint_ring {
    const char *path;    // NULL: no checkpoints are kept
    pm_snapshot_key key; // of the file
    int64_t interval;    // steps
    int size;            // numbers of one checkpoint: its step, then those of the subsystems
    double *state;       // [2][size], the older one first; step -1: none
} pm_checkpoint_ring;

// The flux or report that one request asks for.
typedef struct pm_request_place {
    int64_t instance, attempt; // of the sender
    int64_t key;               // round (process_subsystems.h) or step that was requested
} pm_request_place;

// The requests of one sender, by which new requests are told from old ones.
typedef struct pm_request_filter {
    pm_request_place newest;   // the newest request so far
    pm_request_place repeated; // the last request that was not new
    double since;              // s, when `repeated` was first received
} pm_request_filter;

struct pm_lockstep_node {
    pm_endpoint endpoint;
    pm_arena arena;
    const pm_scene *scene;
    const char *name; // of the process
    pm_process_subsystems subsystems;

    pm_node_phase phase;
    double next, until; // s: when to poll again; when the phase ends (0: set by the next poll)
    int failures;       // reports FAILED sent so far

    // Members that describe the run, taken from the coordinator's ticks.
    portmet_tick_t followed; // the tick by which this node follows its coordinator; its array of
                             // answers is not kept
    int64_t *answers;        // [processes] scratch for the nonces in a tick
    double *live;        // [scene->nlive] borrowed: values of live inputs in the last step granted
    double *heard;       // [scene->nlive] scratch for the values in a tick
    int64_t coordinator; // instance of the coordinator
    int64_t granted;     // steps
    bool want_state;     // reports carry the state z
    bool late;           // in HELLO: a run is under way that this node cannot join
    bool held;           // no further step is granted until somebody asks for it
    bool stays;          // it serves one run after another
    const double *initial; // [scene->nz] borrowed: where a run starts, unless a tick says otherwise
    double *start;         // [scene->nz] scratch for the start in a tick
    double waited;         // s, when it began to wait for a coordinator
    bool coordinator_alive;   // the coordinator sent a message since the last poll
    double coordinator_heard; // s, when a message of the coordinator last arrived

    int rounds;       // largest number of rounds in a step
    int substeps;     // number of substeps of the last step granted
    double asked_at;  // s, when it last published a hello as a question
    int64_t to_ask;   // instance that the next question is for, which waits for its time; 0: none
    int64_t furthest; // largest number of steps that this instance has completed or loaded
    int64_t step;     // the step that is being computed, or comes next
    int round;        // number of the present round within the step
    bool started;     // the flux of the round is published, and its bulk term computed
    bool progressed;  // the node made progress; the next poll begins a new wait
    // [nlink + 1] requests of each neighbour for fluxes, and of the coordinator for reports
    pm_request_filter *requests;

    pm_vitals vitals; // its peers are subsystems.link in order, then the coordinator
    void (*alive)(void *context, int64_t step); // NULL: nobody is told
    void *alive_context;
    double alive_at; // s, when `alive` is due again
    pm_checkpoint_ring checkpoints;
    pm_reporter reporter;
    bool fluxes_show_progress; // reports are not needed at once for the next grant
    double report_at;          // s, when to publish a report that is not full
};

#endif
