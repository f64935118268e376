// The coordinator of a distributed run: a state machine driven by messages and time. It gathers the
// nodes, grants steps, assembles every step's reports into a sample, books it in the ledger and
// hands it to an observer. Nothing in here blocks; lockstep.h has the loops that drive it.
//
// Life: open a session and gather all initial reports -> grant `window` steps beyond the last one
// that all have completed, as their reports or fluxes tell (lookahead.h), until the last -> END, or
// ABORT on any failure; what nodes then still report is booked, too -> finished when all nodes said
// BYE or a short time has passed. Nodes with another digest or version are refused by name, and so
// is a second coordinator for the same session, or where both were started for none.
//
// With a gate (gate.h) it grants no step beyond the one that a file names. While it holds the run
// there it repeats its last tick, by which the nodes know that it is alive; nodes that fall silent
// are still told of, and given up after the scene's patience.
//
// Death and return: with a checkpoint it writes what it and its observer must remember every so
// many steps (checkpoint_ring.h has the same steps for nodes), and after the last one before END.
// Started again, it goes on from there and asks for the reports that it missed. Whoever started the
// processes removes the files, when none of them may come back any more.
#ifndef PM_LOCKSTEP_LOCKSTEP_COORDINATOR_H
#define PM_LOCKSTEP_LOCKSTEP_COORDINATOR_H

#include <stdbool.h>

#include "base/record.h"
#include "sim/ledger.h"
#include "transport/drops.h"
#include "transport/transport.h"

typedef struct pm_lockstep_coordinator pm_lockstep_coordinator;

// `step` is called once per completed step in order, from step 0 (the initial state). The sample is
// valid during the call; its z only with want_state. A failure ends the run.
typedef struct pm_lockstep_observer {
    void *context;
    pm_status (*step)(void *context, const pm_sample *sample);
    // The run has paused because these nodes are silent (named, separated by commas), or goes on
    // (""). May be NULL.
    void (*pause)(void *context, const char *silent);
    // The run is held by the gate after `step`, and every process waits. Called once for each hold.
    // May be NULL.
    void (*hold)(void *context, long step);
    // Puts the numbers that the observer needs to go on after the last step that it was called for.
    // May be NULL.
    void (*record)(void *context, pm_record *record);
    // Makes sure that what the observer has written will survive the process, before a checkpoint
    // is written. May be NULL.
    pm_status (*flush)(void *context);
    // Makes the observer go on after `step`, when its numbers have been restored. May be NULL.
    pm_status (*resume)(void *context, long step);
} pm_lockstep_observer;

typedef struct pm_lockstep_coordinator_options {
    long steps;                    // of the run; 0: as the scene says
    int64_t session;               // > 0: joined by nodes that ask for it; 0: drawn
                                   // (pm_lockstep_session), and open to nodes that ask for none
    bool want_state;               // the observer needs z
    pm_lockstep_observer observer; // step may be NULL
    const char *checkpoint;        // file to keep what it must remember, and to go on from, unless
                                   // it is of another session than `session`; NULL: none
    const char *gate;              // file with the number of steps that may be granted (gate.h);
                                   // NULL: all of them
} pm_lockstep_coordinator_options;

// A number for a new session: 63 bits that two runs hardly share.
int64_t pm_lockstep_session(void);

// Subscribes; says nothing before the first poll. `system` and `transport` must outlive it; once it
// is closed, nobody may wait on the transport any more. `options` may be NULL. PM_ECONFIG, PM_ENET,
// PM_ENOMEM, PM_EFILE (the checkpoint or the gate), and what the observer's restore returns.
pm_status pm_lockstep_coordinator_open(pm_lockstep_coordinator **coordinator,
                                       const pm_system *system, pm_transport *transport,
                                       const pm_lockstep_coordinator_options *options);
void pm_lockstep_coordinator_close(pm_lockstep_coordinator *coordinator); // NULL is allowed

// As pm_lockstep_node_poll and its companions.
double pm_lockstep_coordinator_poll(pm_lockstep_coordinator *coordinator, double now);
void pm_lockstep_coordinator_fail(pm_lockstep_coordinator *coordinator, pm_status code,
                                  const char *message);
bool pm_lockstep_coordinator_finished(const pm_lockstep_coordinator *coordinator);

// PM_OK after the last step; else the failure, with pm_error() set to its description. PM_ETIMEOUT:
// nodes stayed silent, named; PM_ENET: a node was refused, or this coordinator; PM_ELAW; a node's
// own code when it failed; what the observer returned.
pm_status pm_lockstep_coordinator_result(const pm_lockstep_coordinator *coordinator);

long pm_lockstep_coordinator_step(
    const pm_lockstep_coordinator *coordinator); // completed; -1: none
const pm_ledger *pm_lockstep_coordinator_ledger(const pm_lockstep_coordinator *coordinator);
pm_transport *pm_lockstep_coordinator_transport(const pm_lockstep_coordinator *coordinator);
const pm_drops *pm_lockstep_coordinator_drops(const pm_lockstep_coordinator *coordinator);

#endif
