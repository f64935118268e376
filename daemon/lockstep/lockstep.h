// The loops that drive the state machines of a distributed run. A loop drives one node, one
// coordinator, or all nodes and the coordinator of a scene in one thread over the memory transport.
// It waits for messages, polls the state machines and reads the stop flag.
#ifndef PM_LOCKSTEP_LOCKSTEP_H
#define PM_LOCKSTEP_LOCKSTEP_H

#include <signal.h>

#include "lockstep/lockstep_coordinator.h"
#include "lockstep/lockstep_node.h"

// These functions drive a node or a coordinator until the run is over, and return its result
// (pm_lockstep_node_result, pm_lockstep_coordinator_result). When `*stop` becomes non-zero, the run
// ends with PM_EINTERRUPTED within about 0.1 s, and the other processes are told. `stop` may be
// NULL.
pm_status pm_lockstep_run_node(pm_lockstep_node *node, const volatile sig_atomic_t *stop);
pm_status pm_lockstep_run_coordinator(pm_lockstep_coordinator *coordinator,
                                      const volatile sig_atomic_t *stop);

// Runs a whole scene in this thread: `node` [count] and the coordinator are opened on endpoints of
// one hub. Returns the coordinator's result.
pm_status pm_lockstep_run_together(pm_lockstep_coordinator *coordinator, int count,
                                   pm_lockstep_node *const *node,
                                   const volatile sig_atomic_t *stop);

#endif
