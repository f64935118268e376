// The loops that drive a distributed run: one node or one coordinator per process, or all of a
// scene in one thread over the memory transport. The same state machines, messages and bits.
#ifndef PM_LOCKSTEP_LOCKSTEP_H
#define PM_LOCKSTEP_LOCKSTEP_H

#include <signal.h>

#include "lockstep/lockstep_coordinator.h"
#include "lockstep/lockstep_node.h"

// Each waits for messages and polls until the run is over, and returns its result. When `*stop`
// (may be NULL) becomes non-zero, it ends the run with PM_EINTERRUPTED within about 0.1 s, and
// tells the others.
pm_status pm_lockstep_run_node(pm_lockstep_node *node, const volatile sig_atomic_t *stop);
pm_status pm_lockstep_run_coordinator(pm_lockstep_coordinator *coordinator,
                                      const volatile sig_atomic_t *stop);

// A whole scene in this thread, `node` [count] and the coordinator on endpoints of one hub. Returns
// the coordinator's result.
pm_status pm_lockstep_run_together(pm_lockstep_coordinator *coordinator, int count,
                                   pm_lockstep_node *const *node,
                                   const volatile sig_atomic_t *stop);

#endif
