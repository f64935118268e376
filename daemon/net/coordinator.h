// The inside of a coordinator: lockstep_coordinator.c grants and books steps, coordinator_hear.c
// takes messages in, coordinator_memory.c keeps the checkpoint. Private to these three.
#ifndef PM_NET_COORDINATOR_H
#define PM_NET_COORDINATOR_H

#include "net/gathering.h"
#include "net/lockstep_coordinator.h"
#include "net/member.h"
#include "net/party.h"
#include "sim/pace.h"

typedef enum pm_coordinator_phase {
    PM_COORDINATOR_RUNNING,
    PM_COORDINATOR_CLOSING,
    PM_COORDINATOR_FINISHED
} pm_coordinator_phase;

struct pm_lockstep_coordinator {
    pm_party party;
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
    double moved;               // s, when a member was last heard to get on
    bool paused;                // and the observer was told
    bool tick_wanted;           // somebody asked for it since the last poll

    int nmember;
    pm_member *member; // [nmember]
    pm_gathering gathering;
    pm_ledger ledger;
    pm_pace pace;
    const char *checkpoint; // NULL: none
    int64_t interval;       // steps between two
    int nmemory;
    double *memory; // [nmemory] steps completed, then the ledger's, then the observer's
    char ledger_channel[PM_CHANNEL_SIZE];
    double ledger_at; // s, when the next one may be published
};

// Handlers cannot return a failure; they leave it here.
void pm_coordinator_check(pm_lockstep_coordinator *coordinator, pm_status status);

// Subscribes to what it hears. `asked`: the session that it was started for, or 0. PM_ECONFIG,
// PM_ENET, PM_ENOMEM.
pm_status pm_coordinator_listen(pm_lockstep_coordinator *coordinator, int64_t asked);

// Steps to be granted when the reports of `complete` are there.
int64_t pm_coordinator_limit(const pm_lockstep_coordinator *coordinator, int64_t complete);

// Takes up what a coordinator left that died, if it was of the session `asked` (0: any); else
// leaves the first checkpoint, so that this one's session is known. PM_EFILE, PM_ENOMEM, and what
// the observer's restore returns.
pm_status pm_coordinator_recall(pm_lockstep_coordinator *coordinator, int64_t asked);

// Writes the checkpoint. PM_EFILE, and what the observer's save returns.
pm_status pm_coordinator_remember(pm_lockstep_coordinator *coordinator);

#endif
