// A coordinator and its nodes on one hub, in virtual time; what they compute is compared with the
// plain loop, sample by sample. For tests of the lock-step protocol.
#ifndef PM_TESTS_COMPANY_H
#define PM_TESTS_COMPANY_H

#include "fixture.h"
#include "net/lockstep.h"
#include "sim/assembly.h"

#define MAX_NODES 5
#define STEPS 20
#define CHECKPOINT 7 // steps between two checkpoints
#define QUICK_CHECKPOINT 12
#define PATIENCE 2.0 // s, virtual
#define TICK 0.001   // s by which time moves when nobody has a message

typedef struct company {
    fixture f;
    pm_assembly *assembly; // the plain loop, stepped by the observer
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
    pm_hub *hub;
    const char *folder; // for checkpoints; NULL: none are kept
    char path[MAX_NODES + 1][128];
} company;

// A hub, and everything but the nodes: scene and plain loop with `count` links, each its own
// process, or dealt out to `count` processes; endpoints, coordinator.
pm_hub *company_hub(const pm_hub_faults *faults);
void company_open(company *c, int count, int window, pm_hub *hub, int64_t session);
void company_open_dealt(company *c, int nlink, int count, int window, pm_hub *hub);
// A chain of `count` whose steps have one round each, so that fluxes tell of them and reports wait;
// unless `folder` is NULL all keep checkpoints there.
void company_open_quick(company *c, int count, int window, pm_hub *hub, int64_t session,
                        const char *folder);
// As company_open_all, but all keep checkpoints in `folder`.
void company_open_keeping(company *c, int count, int window, pm_hub *hub, int64_t session,
                          const char *folder);
// Node i of the company, whose scene and weights are `system`.
void company_add(company *c, int i, const pm_system *system, int64_t session);
// Both, with all nodes.
void company_open_all(company *c, int count, int window, pm_hub *hub, int64_t session);
void company_close(company *c);

// Node i, or with i = count the coordinator, is gone without a word; and started again as it was.
void company_kill(company *c, int i);
void company_return(company *c, int i);
bool company_has(const company *c, int i);

bool company_is_over(const company *c);
// Everybody's turn; the number of messages handed out. Time passes when there are none; a company
// that goes on for too long fails the test.
int company_turn(company *c);
// Runs on until all are finished; the virtual seconds that took.
double company_run(company *c);
// Until `step` steps are complete.
void company_run_to(company *c, long step);
// For `seconds`, without node `absent`.
void company_run_without(company *c, int absent, double seconds);

// Coordinator and nodes ended well, and all samples were compared.
void assert_all_ok(company *c);
// `status` is `expected`, and pm_error() contains `part`.
void assert_error(pm_status status, pm_status expected, const char *part);
// Coordinator and nodes ended with `code`; the coordinator's error contains `part`.
void assert_all_failed(const company *c, pm_status code, const char *part);

#endif
