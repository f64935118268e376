// Takes turns: every endpoint handles its messages and is polled.
#include "tests/support/together.h"

#include <time.h>

#include "base/progress.h"

#define IDLE_INTERVAL 0.0005 // s of sleep when no endpoint has a message

// Hands out the messages of every endpoint and polls it. Returns the number of messages.
static int take_turns(pm_lockstep_coordinator *coordinator, int count,
                      pm_lockstep_node *const *node, double now) {
    int total = 0, handled = 0;
    pm_status status = pm_transport_wait(coordinator->endpoint.transport, 0, &handled);
    if (status != PM_OK) {
        pm_lockstep_coordinator_fail(coordinator, status, pm_error());
    }
    total += handled;
    (void)pm_lockstep_coordinator_poll(coordinator, now);
    for (int i = 0; i < count; ++i) {
        status = pm_transport_wait(node[i]->endpoint.transport, 0, &handled);
        if (status != PM_OK) {
            pm_lockstep_node_fail(node[i], status, pm_error());
        }
        total += handled;
        (void)pm_lockstep_node_poll(node[i], now);
    }
    return total;
}

// Nodes that only answer requests need not be waited for once the coordinator has finished.
static bool is_over(const pm_lockstep_coordinator *coordinator, int count,
                    pm_lockstep_node *const *node) {
    bool over = pm_lockstep_coordinator_finished(coordinator);
    for (int i = 0; i < count; ++i) {
        over = over && node[i]->phase >= PM_NODE_LEAVING;
    }
    return over;
}

pm_status run_together(pm_lockstep_coordinator *coordinator, int count,
                       pm_lockstep_node *const *node, const volatile sig_atomic_t *stop) {
    const struct timespec idle = {0, (long)(1e9 * IDLE_INTERVAL)};
    while (!is_over(coordinator, count, node)) {
        if (stop != NULL && *stop != 0) {
            pm_lockstep_coordinator_fail(coordinator, PM_EINTERRUPTED, "interrupted");
        }
        if (take_turns(coordinator, count, node, pm_clock()) == 0) {
            nanosleep(&idle, NULL);
        }
    }
    return pm_lockstep_coordinator_result(coordinator);
}
