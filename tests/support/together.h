// Runs a whole scene of several processes in one thread, over the memory transport.
#ifndef PM_TESTS_TOGETHER_H
#define PM_TESTS_TOGETHER_H

#include "lockstep/coordinator.h"
#include "lockstep/node.h"

// Drives `node` [count] and the coordinator, which are opened on endpoints of one hub, until the
// run is over. Returns the coordinator's result. `stop` as in pm_lockstep_run_node.
pm_status run_together(pm_lockstep_coordinator *coordinator, int count,
                       pm_lockstep_node *const *node, const volatile sig_atomic_t *stop);

#endif
