// The coordinator of a distributed run: a state machine driven by messages and time (coordinator.c
// has its table of states). It grants steps to the nodes, assembles every step's reports into a
// sample, enters the sample in the ledger, and hands it to an observer. No function blocks;
// the caller waits on its transport and polls it.
//
// Life cycle: it opens a session and collects the initial state from every node. It then grants
// steps ahead of the last one that all have completed (lookahead.h) until the last step. It ends
// the run with END, or with ABORT on any failure, and is finished when all nodes have said BYE or a
// short time has passed. Nodes with another digest or version are refused by name, and so is a
// second coordinator of the same session.
//
// Live inputs and pace: a step is granted when the values of its live inputs are there
// (live_inputs.h), and no sooner than the scene's pace allows (pace.h).
//
// One run after another: a coordinator that stays waits for pm_lockstep_coordinator_begin, and when
// the run is over, or has failed, for the next one. The processes keep following it: a tick with
// another session, the number of the run and its start takes them to the next run, at the cost of
// one round of messages. After a failure they join anew.
//
// Holding: it grants no step beyond the one that pm_lockstep_coordinator_hold names, which it keeps
// in its checkpoint. While the run is held there it repeats its last tick, which shows the nodes
// that it is alive. As at any other step, the run fails if a node is silent for too long.
//
// Death and return: with a checkpoint it saves its ledger and its observer's state at the steps at
// which the nodes save theirs (node.h), and after the last step before END. After a
// restart it continues from there and requests the reports that it missed. The coordinator never
// removes checkpoint files. The program that started the processes removes them at the end of the
// run.
#ifndef PM_LOCKSTEP_COORDINATOR_H
#define PM_LOCKSTEP_COORDINATOR_H

#include "lockstep/endpoint.h"
#include "lockstep/health.h"
#include "lockstep/live_inputs.h"
#include "lockstep/pace.h"
#include "lockstep/reports.h"
#include "sim/ledger.h"
#include "sim/step_controller.h"
#include "store/snapshot.h"

typedef struct pm_lockstep_coordinator pm_lockstep_coordinator;

// Functions that the coordinator calls during the run, each with `context`. A status other than
// PM_OK ends the run.
typedef struct pm_lockstep_observer {
    void *context;
    // Called once for each completed step in order, from step 0 (the initial state). The sample is
    // valid during the call; its z only with want_state.
    pm_status (*step)(void *context, const pm_sample *sample);
    // Called when the run pauses because the nodes `silent` (names, separated by commas) are
    // silent, and with "" when it continues. May be NULL.
    void (*pause)(void *context, const char *silent);
    // Called once each time somebody holds the run: every process waits after `step`. May be NULL.
    void (*hold)(void *context, long step);
    // Puts the observer's numbers after its last step into the serializer, or restores them. May be
    // NULL.
    void (*record)(void *context, pm_serializer *serializer);
    // Called once a second with the health of the run (health.h). May be NULL.
    void (*health)(void *context, const portmet_health_t *health);
    // Called with a warning for the user: one process makes all others wait, or messages to a
    // process get lost. Each warning is given once. May be NULL.
    void (*warn)(void *context, const char *text);
    // Called before a checkpoint is written: the observer flushes its files, so that they survive
    // the death of the process. May be NULL.
    pm_status (*flush)(void *context);
    // Called after the observer's numbers have been restored: it continues after `step`. May be
    // NULL.
    pm_status (*resume)(void *context, long step);
} pm_lockstep_observer;

typedef struct pm_lockstep_coordinator_options {
    long steps;                    // of the run; 0: as the scene says
    int64_t session;               // > 0: only nodes that were started for this session join; 0:
                                   // the session is drawn at random (pm_lockstep_session), and
                                   // nodes that were started without a session join
    bool want_state;               // the observer needs z
    pm_lockstep_observer observer; // step may be NULL
    const char *checkpoint;        // file of checkpoints, which one that stays does not write (its
                            // processes keep theirs); the run continues from it if it holds the
                            // session `session`, or any session where `session` is 0; NULL:
                            // no checkpoints
    bool stays;           // it serves one run after another, and waits for the first
    bool held;            // the run is held at its start, or where its checkpoint says
    const double *replay; // [replayed][scene->nlive] values of the live inputs in each step; NULL:
    int64_t replayed;     // they arrive on their channels
} pm_lockstep_coordinator_options;

// Returns a random number of 63 bits for a new session, so that two runs are unlikely to share it.
int64_t pm_lockstep_session(void);

// Opens a coordinator and subscribes to its channels; it publishes nothing before the first poll.
// `system`, `transport` and the data that `options` (may be NULL) points to must outlive the
// coordinator. Nobody may wait on the transport after the coordinator is closed. PM_ECONFIG,
// PM_ENET, PM_ENOMEM, PM_EFILE (the checkpoint), and what the observer's resume
// returns.
pm_status pm_lockstep_coordinator_open(pm_lockstep_coordinator **coordinator,
                                       const pm_system *system, pm_transport *transport,
                                       const pm_lockstep_coordinator_options *options);
void pm_lockstep_coordinator_close(pm_lockstep_coordinator *coordinator); // NULL is allowed

// These functions do for a coordinator what pm_lockstep_node_poll, _fail and _finished do for a
// node; `clock` in s, monotonic. A run that fails with PM_OK ends well, before its last step.
double pm_lockstep_coordinator_poll(pm_lockstep_coordinator *coordinator, double clock);
void pm_lockstep_coordinator_fail(pm_lockstep_coordinator *coordinator, pm_status code,
                                  const char *message);
bool pm_lockstep_coordinator_finished(const pm_lockstep_coordinator *coordinator);

// Returns PM_OK after the last step; otherwise the failure, with pm_error() set to its description.
// PM_ETIMEOUT: the nodes named in the description stayed silent; PM_ENET: a node or this
// coordinator was refused; PM_ELAW: a law was violated; a node's own code when it failed; what the
// observer returned.
pm_status pm_lockstep_coordinator_result(const pm_lockstep_coordinator *coordinator);

// A service keeps this of a run after a step, besides the state.
typedef struct pm_lockstep_point {
    int64_t step;
    pm_ledger ledger;
    int substeps;          // that the step controller has chosen for the next step
    double expected_error; // of this step (step_controller.h)
} pm_lockstep_point;

// The run that a coordinator that stays is to begin.
typedef struct pm_lockstep_order {
    int64_t steps;                 // 0: until somebody holds it
    const double *z;               // [scene->nz] the first state, copied; NULL: the scene's
    const pm_lockstep_point *from; // it goes on from there, at `z`; NULL: it begins at step 0
    bool from_outside; // `z` is not the state there: the difference of energy and entropy came
                       // from the outside
    double pace;       // simulated s per s; 0: as fast as it can be
    bool want_state;   // the observer needs z
    pm_lockstep_observer observer;
} pm_lockstep_order;

// Begins a run with a coordinator that stays, in the phase STEPPING or HELD: all processes are
// there. A run that goes on is given up.
void pm_lockstep_coordinator_begin(pm_lockstep_coordinator *coordinator,
                                   const pm_lockstep_order *order);

// Grants no step beyond `step`; INT64_MAX: no limit. Steps that are granted already are computed.
void pm_lockstep_coordinator_hold(pm_lockstep_coordinator *coordinator, int64_t step);

// Returns the number of processes that have said hello.
int pm_lockstep_coordinator_present(const pm_lockstep_coordinator *coordinator);

// These functions return the ledger of the completed steps, how the run kept its pace, the
// transport that the coordinator was opened on, and the counts of used and dropped messages. The
// coordinator owns ledger, pace and counts.
const pm_pace *pm_lockstep_coordinator_pace(const pm_lockstep_coordinator *coordinator);
const pm_ledger *pm_lockstep_coordinator_ledger(const pm_lockstep_coordinator *coordinator);
pm_transport *pm_lockstep_coordinator_transport(const pm_lockstep_coordinator *coordinator);
const pm_drops *pm_lockstep_coordinator_drops(const pm_lockstep_coordinator *coordinator);

// --- the inside of a coordinator, for coordinator.c and for tests ---

typedef enum pm_coordinator_phase {
    PM_COORDINATOR_GATHERING, // not every process has reported the initial state
    PM_COORDINATOR_STEPPING,
    PM_COORDINATOR_HELD,    // every granted step is complete, and no more can be granted
    PM_COORDINATOR_CLOSING, // this one and the next: the run is over
    PM_COORDINATOR_FINISHED
} pm_coordinator_phase;

struct pm_lockstep_coordinator {
    pm_endpoint endpoint;
    pm_arena arena;
    const pm_scene *scene;
    pm_lockstep_observer observer;
    bool want_state;      // reports carry the state z
    bool stays;           // it serves one run after another
    bool waits;           // it stays, and no run has begun since its processes came
    int64_t run;          // number of the run, from 1
    int64_t hold_at;      // steps that may be granted; INT64_MAX: all of them
    bool was_held;        // somebody has held the run, so that processes may rest
    int64_t first;        // step at whose state the processes joined
    int64_t booked;       // last step that was booked before they did
    bool from_outside;    // their state was set by somebody
    double *start;        // [nz] where the run starts, if it stays and `starts_anywhere`
    bool starts_anywhere; // not where the scene says
    pm_sample *last;      // of the last step completed, if `want_state`
    double held_at;       // s, when the run was last held
    bool flushed;         // the observer has flushed its files since then
    bool sums;            // reports have sums, and list only some subsystems
    int nbetween;
    int *between; // [nbetween] ports between two processes, which no report sums up

    pm_coordinator_phase phase;
    double next;     // s, when the next command is due
    int commands;    // END or ABORT sent so far
    double hello_at; // s, when the next hello is due

    int lookahead;              // most steps granted beyond the last complete one (lookahead.h)
    bool hears_fluxes;          // it learns from fluxes which steps are complete (lookahead.h)
    int64_t completed, granted; // steps; completed is first - 1 before that state is known
    bool failed;                // a step could not enter the ledger; no later one enters
    bool progressed;            // the run made progress; the next poll begins a new wait
    bool fluxes_requested;      // this wait has requested fluxes; it requests reports next
    double moved;               // s, when a process last made progress
    bool paused;                // the observer was told that the run pauses
    bool tick_wanted;           // the next poll publishes a tick that answers a message
    double ticked_at;           // s, when the last tick was published
    bool hello_wanted;          // the next poll publishes a hello, since a process named another
                                // coordinator
    int nanswer;
    int64_t *answer;          // [nremote] nonces of the hellos that the next tick answers
    unsigned char *tick_data; // [tick_capacity] the encoded tick, with up to nremote answers
    size_t tick_capacity;

    int nremote;
    pm_remote_process *remote; // [nremote]
    pm_pace pace;
    pm_live_inputs live;
    double live_until;  // s, when the observer is told that the run waits for a live input
    bool live_disputed; // it was told that two messages have other values for the same step
    pm_report_window reports;
    pm_health health;
    pm_ledger ledger;
    pm_step_controller step_controller;
    const char *checkpoint; // file; NULL: none
    int64_t interval;       // steps between two checkpoints
    pm_snapshot_key checkpoint_key;
    double *checkpoint_state; // [checkpoint_key.count] steps completed, ledger, observer
    char ledger_channel[PM_CHANNEL_SIZE];
    double ledger_at; // s, when the next ledger message may be published
};

#endif
