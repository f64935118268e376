// Drives a coordinator without clients, for measurements.
#ifndef PM_TESTS_RUN_COORDINATOR_H
#define PM_TESTS_RUN_COORDINATOR_H

#include "base/progress.h"
#include "lockstep/coordinator.h"

// Polls a coordinator until the run is over, and returns its result.
static inline pm_status run_coordinator(pm_lockstep_coordinator *c) {
    while (!pm_lockstep_coordinator_finished(c)) {
        const double now = pm_clock(), next = pm_lockstep_coordinator_poll(c, now);
        const double wait = next - now < 0.1 ? next - now : 0.1;
        PM_TRY(pm_transport_wait(pm_lockstep_coordinator_transport(c), wait > 0 ? wait : 0, NULL));
    }
    return pm_lockstep_coordinator_result(c);
}

#endif
