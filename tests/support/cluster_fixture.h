// A coordinator and its nodes on one hub, in virtual time, for tests of the lock-step protocol.
// Every sample is compared with that of the plain loop (sim/monolithic.h).
#ifndef PM_TESTS_CLUSTER_FIXTURE_H
#define PM_TESTS_CLUSTER_FIXTURE_H

#include "lockstep/coordinator.h"
#include "lockstep/node.h"
#include "sim/monolithic.h"
#include "tests/support/fixture.h"
#include "tests/support/memory_hub.h"

#define MAX_NODES 5
#define STEPS 20
#define CHECKPOINT 7 // steps between two checkpoints
#define QUICK_CHECKPOINT 12
#define PATIENCE 2.0 // s, virtual
#define TICK 0.001   // s by which time advances when no endpoint has a message

typedef struct cluster {
    fixture f;
    pm_monolithic *assembly; // the plain loop, stepped by the observer
    long steps_seen;
    long allocations_at_step_5;
    long fail_at_step; // the observer fails at this step; -1: never
    double now;        // s, virtual
    int64_t session;   // for which all processes are started
    long steps;        // of the run
    int nlink, count;  // subsystems, and the processes that serve them
    pm_transport *transport[MAX_NODES];
    pm_lockstep_node *node[MAX_NODES]; // NULL: absent
    pm_transport *coordinator_transport;
    pm_lockstep_coordinator *coordinator;
    long (*count_allocations)(void); // NULL: allocations are not counted
    char silent[64];                 // the nodes that the coordinator last called silent
    int pauses;                      // calls of the observer's pause
    bool held;                       // the run is held at its start
    bool stays;                      // coordinator and nodes serve one run after another
    long held_at;                    // the step of the last call of the observer's hold
    int holds;                       // calls of the observer's hold
    pm_hub *hub;
    const char *folder; // of checkpoints; NULL: none are kept
    char path[MAX_NODES + 1][128];
} cluster;

// Opens a hub; scene, plain loop, endpoints and coordinator for `count` links, one in each process,
// or for `nlink` links that are distributed to `count` processes. `faults` may be NULL.
pm_hub *cluster_hub(const pm_hub_faults *faults);
void cluster_open(cluster *c, int count, int window, pm_hub *hub, int64_t session);
void cluster_open_dealt(cluster *c, int nlink, int count, int window, pm_hub *hub);
// Opens a chain of `count` links whose steps have one round each, so that fluxes show progress and
// reports hold several steps. With `folder`, all processes keep checkpoints there.
void cluster_open_quick(cluster *c, int count, int window, pm_hub *hub, int64_t session,
                        const char *folder);
// Does what cluster_open_all does; all processes keep checkpoints in `folder`.
void cluster_open_keeping(cluster *c, int count, int window, pm_hub *hub, int64_t session,
                          const char *folder);
// Opens node i of the cluster with the scene and weights `system`.
void cluster_add(cluster *c, int i, const pm_system *system, int64_t session);
// Does what cluster_open does, and opens all nodes.
void cluster_open_all(cluster *c, int count, int window, pm_hub *hub, int64_t session);
void cluster_close(cluster *c);
// Closes the cluster and its hub, which is to have no other endpoint.
void cluster_end(cluster *c);

// For node i, or the coordinator if i = count: cluster_kill closes it without a message,
// cluster_return starts it again with the same options, and cluster_has returns true if it exists.
void cluster_kill(cluster *c, int i);
void cluster_return(cluster *c, int i);
bool cluster_has(const cluster *c, int i);

// The instances of the coordinator and of a node, and the nonce of a node's present hello.
int64_t cluster_instance(const cluster *c);
int64_t cluster_node_instance(const pm_lockstep_node *node);
int64_t cluster_nonce(const pm_lockstep_node *node);
// True if a node takes part in a run.
bool cluster_has_joined(const pm_lockstep_node *node);

bool cluster_is_over(const cluster *c);
// Passes the waiting messages to every endpoint and polls it. Returns the number of messages; time
// advances when there are none. A run that takes too long fails the test.
int cluster_turn(cluster *c);
// Returns the number of steps that a node, or the coordinator, has completed; of the latter -1
// before the initial state is known.
long cluster_node_step(const pm_lockstep_node *node);
long cluster_coordinator_step(const pm_lockstep_coordinator *coordinator);

// Runs until all have finished. Returns the virtual time that took, s.
double cluster_run(cluster *c);
// Runs until `step` steps are complete.
void cluster_run_to(cluster *c, long step);
// Runs for `seconds`, without polling node `absent`.
void cluster_run_without(cluster *c, int absent, double seconds);

// An observer's step with the cluster as its context: compares the sample with the plain loop's.
pm_status cluster_compare(void *context, const pm_sample *sample);

// Asserts that coordinator and nodes ended well, and that all samples were compared.
void assert_all_ok(cluster *c);
// Asserts that `status` is `expected`, and that pm_error() contains `part`.
void assert_error(pm_status status, pm_status expected, const char *part);
// Asserts that coordinator and nodes ended with `code`, and that the coordinator's error contains
// `part`.
void assert_all_failed(const cluster *c, pm_status code, const char *part);

#endif
