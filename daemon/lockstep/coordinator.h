// The inside of a coordinator: lockstep_coordinator.c grants and books steps, coordinator_hear.c
// takes messages in, coordinator_checkpoint.c keeps the checkpoint. Private to these three.
#ifndef PM_LOCKSTEP_COORDINATOR_H
#define PM_LOCKSTEP_COORDINATOR_H

#include "lockstep/endpoint.h"
#include "lockstep/gate.h"
#include "lockstep/lockstep_coordinator.h"
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
    bool want_state;

    pm_coordinator_phase phase;
    double next;     // s, next command
    int commands;    // END or ABORT sent so far
    bool greeted;    // said hello
    double greet_at; // s, when to say it again

    int lead;                   // steps granted beyond the last complete one, at most
    bool hears_fluxes;          // and no more than a window beyond the last one they tell of
    int64_t completed, granted; // steps; completed is -1 before the initial state is known
    bool failed;                // to book a step: no later one is booked
    bool progressed;            // since the last poll: a new wait begins
    bool fluxes_asked;          // in this wait: next time it is reports
    double moved;               // s, when a remote was last heard to get on
    bool paused;                // and the observer was told
    bool held;                  // at the gate, after the last step it allows
    bool tick_wanted;           // somebody asked for it since the last poll

    int nremote;
    pm_remote_process *remote; // [nremote]
    pm_gate gate;
    pm_report_window window_reports;
    pm_ledger ledger;
    pm_step_controller pace;
    const char *checkpoint; // NULL: none
    int64_t interval;       // steps between two
    pm_snapshot_key checkpoint_key;
    double *memory; // [checkpoint_key.count] steps completed, then the ledger's and the observer's
    char ledger_channel[PM_CHANNEL_SIZE];
    double ledger_at; // s, when the next one may be published
};

// Handlers cannot return a failure; they leave it here.
void pm_coordinator_check(pm_lockstep_coordinator *coordinator, pm_status status);

// Subscribes to what it hears. `asked`: the session that it was started for, or 0. PM_ECONFIG,
// PM_ENET, PM_ENOMEM.
pm_status pm_coordinator_listen(pm_lockstep_coordinator *coordinator, int64_t asked);

// Steps to be granted when the reports of `complete` are there, as far as the gate allows.
int64_t pm_coordinator_limit(const pm_lockstep_coordinator *coordinator, int64_t complete);

// Takes up what a coordinator left that died, if it was of the session `asked` (0: any); else
// leaves the first checkpoint, so that this one's session is known. PM_EFILE, PM_ENOMEM, and what
// the observer's restore returns.
pm_status pm_coordinator_recall(pm_lockstep_coordinator *coordinator, int64_t asked);

// Writes the checkpoint. PM_EFILE, and what the observer's save returns.
pm_status pm_coordinator_remember(pm_lockstep_coordinator *coordinator);

#endif
