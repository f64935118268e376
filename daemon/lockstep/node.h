// The inside of a node: lockstep_node.c polls and waits, node_steps.c computes, node_hear.c takes
// messages in. Private to these three.
#ifndef PM_LOCKSTEP_NODE_H
#define PM_LOCKSTEP_NODE_H

#include "lockstep/checkpoint_ring.h"
#include "lockstep/endpoint.h"
#include "lockstep/lockstep_node.h"
#include "lockstep/process_subsystems.h"
#include "lockstep/reporter.h"
#include "lockstep/request_filter.h"

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
    const char *name;
    pm_process_subsystems group;

    pm_node_phase phase;
    double next, until; // s: next poll needed; end of the phase

    // Of the run, from the coordinator's ticks.
    int64_t coordinator; // its instance
    int64_t granted;
    double t0;
    bool want_state;
    bool late; // in HELLO: a run is under way that it cannot join
    bool coordinator_alive;
    double coordinator_heard;

    int rounds;   // per step, at most
    int substeps; // of the last step granted
    int64_t step; // being computed, or next
    int round;
    bool started;            // the round
    bool progressed;         // since the last poll; a new wait begins
    pm_request_filter asked; // by the coordinator, for reports

    pm_checkpoint_ring history;
    pm_reporter reporter;
    bool fluxes_tell; // of its steps, so that reports need not
    double report_at; // s, when to report what is gathered, full or not
};

// The phase's clock starts at the next poll, as handlers do not know the time.
void pm_node_enter(pm_lockstep_node *node, pm_node_phase next);

// Handlers cannot return a failure; they leave it here.
void pm_node_check(pm_lockstep_node *node, pm_status status);

// --- steps ---

// The present round, counted from the start of the run.
int64_t pm_node_key(const pm_lockstep_node *node);

// Is the present step granted?
bool pm_node_is_granted(const pm_lockstep_node *node);

// May the next round begin?
bool pm_node_may_start(const pm_lockstep_node *node);

// From the initial state, or where this process stood when it died.
pm_status pm_node_begin(pm_lockstep_node *node);

// Computes as far as the neighbours' fluxes and the time between two polls allow.
pm_status pm_node_compute(pm_lockstep_node *node);

// Computes again from the newest checkpoint of at most `step` steps, if there is one.
pm_status pm_node_go_back(pm_lockstep_node *node, int64_t step);

// --- messages ---

// Subscribes to what it hears. `asked`: the session that it was started for, or 0. PM_ECONFIG,
// PM_ENET, PM_ENOMEM.
pm_status pm_node_listen(pm_lockstep_node *node, int64_t asked);

#endif
