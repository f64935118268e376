// The inside of a coordinator, private to its four files and to tests: lockstep_coordinator.c
// polls, grants steps, enters them in the ledger and ends the run; coordinator_messages.c handles
// messages; coordinator_checkpoint.c saves and loads the checkpoint; coordinator_state.c holds
// functions that these three share. Each file calls only files named after it.
//
// The state machine. GATHERING, STEPPING and HELD are one phase, PM_COORDINATOR_RUNNING; the
// members `completed` and `held` tell these states apart. `patience` is a key of the scene, in s. A
// coordinator that is started with a checkpoint begins in STEPPING with a tick. A tick and a
// command that answer a hello repeat its nonce (identity.h). Hellos and notices (FAILED, BYE) of
// processes count only if they name this coordinator, which shows that they are not of an earlier
// run. "The observer" is the set of functions in lockstep_coordinator.h.
//
// state      awaits             message or time-out              next       sends
// ---------  -----------------  -------------------------------  ---------  ---------------------
// GATHERING  every process's    0.1 s passed                     GATHERING  hello
//            report of step 0   hello with another digest        CLOSING    REFUSE to the sender
//                               every report has arrived         STEPPING   tick, ledger
// STEPPING   reports of         every report of a step arrived   STEPPING   tick, ledger
//            granted steps,     flux that shows progress         STEPPING   tick if it may grant
//            or fluxes that     request for a tick               STEPPING   tick
//            show progress      no further step may be granted   HELD       tell the observer
//                               every report of the last step    CLOSING    ledger
// HELD       a larger number    gate file with a larger number   STEPPING   tick
//            in the gate file;  every value of the next step     STEPPING   tick
//            live inputs; the     has arrived
//            clock              the next step is due             STEPPING   tick
//                               time to request (waiting.h)      HELD       tick, as a sign of life
// any of                        1 s passed                       the same   health
// these                         hello that names another         the same   hello
// three                           coordinator, or none
//                               hello of a process that fits     the same   tick
//                               time to request, not HELD        the same   request for fluxes,
//                                                                           then for reports
//                               a process silent for 2 s         the same   tell the observer
//                               a process silent for patience    CLOSING
//                               no progress in 3 patience,       CLOSING
//                                 though every process sends
//                               report FAILED; own failure       CLOSING
//                               two reports of a step that       CLOSING
//                                 contradict each other; BYE:
//                                 a message was forged
//                               hello of a later coordinator     the same   REFUSE to the sender
//                               REFUSE that answers its hello    FINISHED
// CLOSING    BYE of every       0.02 s passed                    CLOSING    END, or ABORT
//            process            hello                            CLOSING    END; after a failure
//                                                                             REFUSE
//                               every BYE, or END or ABORT       FINISHED
//                                 was sent 11 times
#ifndef PM_LOCKSTEP_COORDINATOR_H
#define PM_LOCKSTEP_COORDINATOR_H

#include "lockstep/endpoint.h"
#include "lockstep/gate.h"
#include "lockstep/health.h"
#include "lockstep/live_inputs.h"
#include "lockstep/lockstep_coordinator.h"
#include "lockstep/pace.h"
#include "lockstep/remote_process.h"
#include "lockstep/report_window.h"
#include "sim/step_controller.h"
#include "store/snapshot.h"

typedef enum pm_coordinator_phase {
    PM_COORDINATOR_RUNNING,
    PM_COORDINATOR_CLOSING,
    PM_COORDINATOR_FINISHED
} pm_coordinator_phase;

struct pm_lockstep_coordinator {
    pm_endpoint endpoint;
    pm_arena arena;
    pm_lockstep_observer observer;
    bool want_state; // reports carry the state z
    bool sums;       // reports have sums, and list only some subsystems
    int nbetween;
    int *between; // [nbetween] ports between two processes, which no report sums up

    pm_coordinator_phase phase;
    double next;     // s, when the next command is due
    int commands;    // END or ABORT sent so far
    bool said_hello; // at least once
    double hello_at; // s, when the next hello is due

    int lookahead;              // most steps granted beyond the last complete one (lookahead.h)
    bool hears_fluxes;          // it learns from fluxes which steps are complete (lookahead.h)
    int64_t completed, granted; // steps; completed is -1 before the initial state is known
    bool failed;                // a step could not enter the ledger; no later one enters
    bool progressed;            // the run made progress; the next poll begins a new wait
    bool fluxes_requested;      // this wait has requested fluxes; it requests reports next
    double moved;               // s, when a process last made progress
    bool paused;                // the observer was told that the run pauses
    bool held;                  // every granted step is complete, and no more can be granted
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
    pm_gate gate;
    pm_pace pace;
    pm_live_inputs live;
    double live_until; // s, when the observer is told that the run waits for a live input
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

// --- state (coordinator_state.c) ---

// Ends the run if `status` is a failure. Message handlers, which cannot return a status, call this
// function.
void pm_coordinator_check(pm_lockstep_coordinator *coordinator, pm_status status);

// Enters CLOSING. Processes then receive END if the endpoint's status is PM_OK, and ABORT
// otherwise.
void pm_coordinator_close_run(pm_lockstep_coordinator *coordinator);

// Returns the number of steps that may be granted when the reports of the first `complete` steps
// have arrived. It is at most `complete` plus the lookahead, and at most the number that the gate,
// the pace and the live inputs allow. If fluxes show progress, it is also at most a window beyond
// the slowest process.
int64_t pm_coordinator_grant_limit(const pm_lockstep_coordinator *coordinator, int64_t complete);

// Returns the number of steps that every process has completed, as far as reports and fluxes show.
int64_t pm_coordinator_steps_shown(const pm_lockstep_coordinator *coordinator);

// Enters the complete sample of a step, or the sums of its reports and the ports between processes,
// in the ledger. Fails as pm_ledger_book does.
pm_status pm_coordinator_enter(pm_lockstep_coordinator *coordinator, pm_sample *sample);

// Returns true if the gate allows no step beyond those that are granted.
bool pm_coordinator_is_at_gate(const pm_lockstep_coordinator *coordinator);

// --- messages (coordinator_messages.c) ---

// Opens the endpoint and subscribes to reports, to all requests, and to fluxes if they show
// progress. `session` is the session that the coordinator was started for, or 0. PM_ECONFIG,
// PM_ENET, PM_ENOMEM.
pm_status pm_coordinator_listen(pm_lockstep_coordinator *coordinator, int64_t session);

// --- checkpoint (coordinator_checkpoint.c) ---

// Continues from the checkpoint file if it holds a checkpoint of `session` (0: of any session).
// Otherwise writes a first checkpoint, so that a restarted coordinator knows the session of this
// run. Does nothing without a checkpoint file. PM_EFILE, PM_ENOMEM, and what the observer's resume
// returns.
pm_status pm_coordinator_load_checkpoint(pm_lockstep_coordinator *coordinator, int64_t session);

// Writes the checkpoint of the step `completed`. PM_EFILE, and what the observer's flush returns.
pm_status pm_coordinator_save_checkpoint(pm_lockstep_coordinator *coordinator);

#endif
