// A coordinator and its nodes on one hub, in virtual time; what they compute is compared with the
// plain loop, sample by sample. For tests of the lock-step protocol.
#ifndef PM_TESTS_CLUSTER_FIXTURE_H
#define PM_TESTS_CLUSTER_FIXTURE_H

#include "lockstep/lockstep.h"
#include "sim/monolithic.h"
#include "tests/support/fixture.h"

#define MAX_NODES 5
#define STEPS 20
#define CHECKPOINT 7 // steps between two checkpoints
#define QUICK_CHECKPOINT 12
#define PATIENCE 2.0 // s, virtual
#define TICK 0.001   // s by which time moves when nobody has a message

typedef struct cluster {
    fixture f;
    pm_monolithic *assembly; // the plain loop, stepped by the observer
    long steps_seen;
    long allocations_at_step_5;
    long fail_at_step; // the observer fails there; -1: never
    double now;        // s, virtual
    int64_t session;   // that all were started for
    long steps;        // of the run
    int nlink, count;  // subsystems, and the processes that serve them
    pm_transport *transport[MAX_NODES];
    pm_lockstep_node *node[MAX_NODES]; // NULL: absent
    pm_transport *coordinator_transport;
    pm_lockstep_coordinator *coordinator;
    long (*count_allocations)(void); // NULL: not of interest
    char silent[64];                 // who the coordinator said was silent, last
    int pauses;                      // how often it said so, or that the run goes on
    const char *gate;                // NULL: none
    long held_at;                    // the step after which the coordinator said that it is held
    int holds;                       // how often it said so
    pm_hub *hub;
    const char *folder; // for checkpoints; NULL: none are kept
    char path[MAX_NODES + 1][128];
} cluster;

// A hub, and everything but the nodes: scene and plain loop with `count` links, each its own
// process, or dealt out to `count` processes; endpoints, coordinator.
pm_hub *cluster_hub(const pm_hub_faults *faults);
void cluster_open(cluster *c, int count, int window, pm_hub *hub, int64_t session);
void cluster_open_dealt(cluster *c, int nlink, int count, int window, pm_hub *hub);
// A chain of `count` whose steps have one round each, so that fluxes tell of them and reports wait;
// unless `folder` is NULL all keep checkpoints there.
void cluster_open_quick(cluster *c, int count, int window, pm_hub *hub, int64_t session,
                        const char *folder);
// As cluster_open_all, but all keep checkpoints in `folder`.
void cluster_open_keeping(cluster *c, int count, int window, pm_hub *hub, int64_t session,
                          const char *folder);
// Node i of the cluster, whose scene and weights are `system`.
void cluster_add(cluster *c, int i, const pm_system *system, int64_t session);
// Both, with all nodes.
void cluster_open_all(cluster *c, int count, int window, pm_hub *hub, int64_t session);
void cluster_close(cluster *c);

// Node i, or with i = count the coordinator, is gone without a word; and started again as it was.
void cluster_kill(cluster *c, int i);
void cluster_return(cluster *c, int i);
bool cluster_has(const cluster *c, int i);

bool cluster_is_over(const cluster *c);
// Everybody's turn; the number of messages handed out. Time passes when there are none; a cluster
// that goes on for too long fails the test.
int cluster_turn(cluster *c);
// Runs on until all are finished; the virtual seconds that took.
double cluster_run(cluster *c);
// Until `step` steps are complete.
void cluster_run_to(cluster *c, long step);
// For `seconds`, without node `absent`.
void cluster_run_without(cluster *c, int absent, double seconds);

// Coordinator and nodes ended well, and all samples were compared.
void assert_all_ok(cluster *c);
// `status` is `expected`, and pm_error() contains `part`.
void assert_error(pm_status status, pm_status expected, const char *part);
// Coordinator and nodes ended with `code`; the coordinator's error contains `part`.
void assert_all_failed(const cluster *c, pm_status code, const char *part);

#endif
