// The inside of a node, private to its five files and to tests: lockstep_node.c polls, waits and
// ends; node_messages.c handles messages, node_orders.c those of the coordinator; node_steps.c
// computes rounds and steps; node_state.c holds functions that these share. Each file calls only
// files named after it.
//
// The state machine. A round begins as soon as the round before it is complete and its step is
// granted. `patience` is a key of the scene, in s. "With a checkpoint" means that this node keeps
// checkpoints. A message is "proven" if it repeats the nonce of this node's present hello
// (identity.h). "Its coordinator" is the one whose tick was proven last; a node asks a coordinator
// by a hello that names it. Messages that nobody can have sent in this run are dropped first.
//
// state    awaits             message or time-out                next      sends
// -------  -----------------  ---------------------------------  --------  ---------------------
// HELLO    a tick             0.1 s passed                       HELLO     hello
//                             hello, tick, END or ABORT of an    HELLO     hello that names it
//                               unknown coordinator
//                             proven tick, granted = 0           RUNNING   report of step 0
//                             proven tick, granted > 0, and a    RUNNING   hello
//                               checkpoint of its session
//                             patience passed                    FAILING
//                             proven END (with a checkpoint)     LEAVING   BYE
//                               or proven ABORT
// RUNNING  a grant; every     tick that grants more              RUNNING   flux of the round
//          neighbour's flux   every flux of a round is there     RUNNING   flux of the next round
//          of the round       every round of a step is complete  RUNNING   report: when full, 20 ms
//                                                                          old, or awaited
//                             time to request (waiting.h)        RUNNING   request for the missing
//                                                                          flux, else for a tick;
//                                                                          a hello instead before
//                                                                          the first grant
//                             request for a buffered message     RUNNING   flux or report again
//                             new request for an older message   RUNNING   none: roll back to the
//                                                                          checkpoint before it
//                             hello, tick or command of          RUNNING   hello that names it
//                               another coordinator; refusal
//                               that is not proven; END before
//                               the last step (with a
//                               checkpoint); a long wait
//                             proven tick of another             RUNNING
//                               coordinator, which becomes
//                               its coordinator
//                             two fluxes of a round, or two      FAILING
//                               ticks, that contradict each
//                               other: one is forged
//                             coordinator silent for patience    FAILING
//                             ABORT of its coordinator, its END  LEAVING   BYE
//                               after the last step, proven END
//                               or ABORT
// FAILING  ABORT              0.02 s passed                      FAILING   report FAILED
//                             ABORT                              LEAVING   BYE
//                             FAILED was sent 16 times           FINISHED
// LEAVING  nothing            END or ABORT again                 LEAVING   BYE
//                             request for a buffered message     LEAVING   flux or report again
//                             0.15 s passed                      FINISHED
// RUNNING                     pm_vitals_interval passed          RUNNING   vitals
// HELLO or                    hello of a later node of its name  the same  REFUSE to the sender
// RUNNING                     own failure, interrupt             FAILING
// HELLO to                    proven REFUSE of this node         FINISHED  BYE, if it took part and
// FAILING                                                                    keeps no checkpoint
#ifndef PM_LOCKSTEP_NODE_H
#define PM_LOCKSTEP_NODE_H

#include "lockstep/checkpoint_ring.h"
#include "lockstep/endpoint.h"
#include "lockstep/lockstep_node.h"
#include "lockstep/process_subsystems.h"
#include "lockstep/reporter.h"
#include "lockstep/request_filter.h"
#include "lockstep/vitals.h"

typedef enum pm_node_phase {
    PM_NODE_HELLO,
    PM_NODE_RUNNING,
    PM_NODE_FAILING,
    PM_NODE_LEAVING,
    PM_NODE_FINISHED
} pm_node_phase;

struct pm_lockstep_node {
    pm_endpoint endpoint;
    pm_arena arena;
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
    double t0;           // s, time at step 0
    bool want_state;     // reports carry the state z
    bool late;           // in HELLO: a run is under way that this node cannot join
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
    pm_request_filter coordinator_requests; // the coordinator's requests for reports

    pm_vitals vitals; // its peers are subsystems.link in order, then the coordinator
    void (*alive)(void *context, int64_t step); // NULL: nobody is told
    void *alive_context;
    double alive_at; // s, when `alive` is due again
    pm_checkpoint_ring checkpoints;
    pm_reporter reporter;
    bool fluxes_show_progress; // reports are not needed at once for the next grant
    double report_at;          // s, when to publish a report that is not full
};

// --- state (node_state.c) ---

// Enters another phase. The clock of the phase starts at the next poll, since handlers do not know
// the time.
void pm_node_enter(pm_lockstep_node *node, pm_node_phase next);

// Enters FAILING if `status` is a failure. Message handlers, which cannot return a status, call
// this function.
void pm_node_check(pm_lockstep_node *node, pm_status status);

// Publishes a hello that asks the instance `coordinator`: in HELLO at the next poll, later at once
// or 0.01 s after the last question.
void pm_node_ask(pm_lockstep_node *node, int64_t coordinator);

// Publishes the question that waits for its time, if it has come. Returns the time at which it will
// come, s; INFINITY: none waits.
double pm_node_publish_question(pm_lockstep_node *node);

// Returns the position of a neighbour among the peers of the vitals; NULL stands for the
// coordinator.
int pm_node_peer(const pm_lockstep_node *node, const pm_flux_link *link);

// Notes that a message of a neighbour (NULL: of the coordinator) was used.
void pm_node_note_used(pm_lockstep_node *node, const pm_flux_link *link);

// --- orders (node_orders.c) ---

// The handlers of ticks and of commands. `context` is the node.
void pm_node_on_tick(void *context, const char *channel, const void *data, size_t size);
pm_drop pm_node_accept_command(void *context, const portmet_command_t *command);

// --- messages (node_messages.c) ---

// Opens the endpoint and subscribes to ticks and the neighbours' fluxes. `session` is the session
// that the node was started for, or 0. PM_ECONFIG, PM_ENET, PM_ENOMEM.
pm_status pm_node_listen(pm_lockstep_node *node, int64_t session);

// --- steps (node_steps.c) ---

// Returns the time at the start of a step, s.
double pm_node_time(const pm_lockstep_node *node, int64_t step);

// Returns the key of the present round: its number, counted from the start of the run.
int64_t pm_node_round_key(const pm_lockstep_node *node);

// Returns true if the next round may begin.
bool pm_node_may_start(const pm_lockstep_node *node);

// Begins at the initial state, or at this process's last checkpoint of the session, and reports the
// initial state. Fails as the functions of checkpoint_ring.h and reporter.h do.
pm_status pm_node_start_run(pm_lockstep_node *node);

// Computes rounds until a grant or a neighbour's flux is missing, but at most 16 steps. Fails as
// the functions of process_subsystems.h, checkpoint_ring.h and reporter.h do.
pm_status pm_node_compute(pm_lockstep_node *node);

// Returns to the newest checkpoint of at most `step` steps, to compute again from there. Changes no
// state if there is none. Publishes the report being filled first. Fails as pm_reporter_flush does.
pm_status pm_node_roll_back(pm_lockstep_node *node, int64_t step);

#endif
