// The loops around the state machines: wait for messages, poll, read the stop flag.
#include "lockstep/lockstep.h"

#include <math.h>
#include <time.h>

#include "base/progress.h"

// Another thread (LCM's) may receive the signal, which then does not wake this one.
#define STOP_INTERVAL 0.1 // s between two readings of the stop flag, at most

#define IDLE_INTERVAL 0.0005 // s of sleep when no endpoint has a message

static bool is_set(const volatile sig_atomic_t *stop) {
    return stop != NULL && *stop != 0;
}

static double wait_time(double next, double now) {
    const double wait = next - now;
    return wait <= 0 ? 0 : wait < STOP_INTERVAL ? wait : STOP_INTERVAL;
}

pm_status pm_lockstep_run_node(pm_lockstep_node *node, const volatile sig_atomic_t *stop) {
    pm_transport *transport = pm_lockstep_node_transport(node);
    double now = pm_clock();
    double next = pm_lockstep_node_poll(node, now);
    while (!pm_lockstep_node_finished(node)) {
        pm_lockstep_node_rest(node, pm_clock());
        const pm_status status = pm_transport_wait(transport, wait_time(next, now), NULL);
        if (status != PM_OK) {
            pm_lockstep_node_fail(node, status, pm_error());
        }
        if (is_set(stop)) {
            pm_lockstep_node_fail(node, PM_EINTERRUPTED, "interrupted");
        }
        now = pm_clock();
        next = pm_lockstep_node_poll(node, now);
    }
    return pm_lockstep_node_result(node);
}

pm_status pm_lockstep_run_coordinator(pm_lockstep_coordinator *coordinator,
                                      const volatile sig_atomic_t *stop) {
    pm_transport *transport = pm_lockstep_coordinator_transport(coordinator);
    double now = pm_clock();
    double next = pm_lockstep_coordinator_poll(coordinator, now);
    while (!pm_lockstep_coordinator_finished(coordinator)) {
        const pm_status status = pm_transport_wait(transport, wait_time(next, now), NULL);
        if (status != PM_OK) {
            pm_lockstep_coordinator_fail(coordinator, status, pm_error());
        }
        if (is_set(stop)) {
            pm_lockstep_coordinator_fail(coordinator, PM_EINTERRUPTED, "interrupted");
        }
        now = pm_clock();
        next = pm_lockstep_coordinator_poll(coordinator, now);
    }
    return pm_lockstep_coordinator_result(coordinator);
}

// Hands out the messages of every endpoint and polls it. Returns the number of messages.
static int take_turns(pm_lockstep_coordinator *coordinator, int count,
                      pm_lockstep_node *const *node, double now) {
    int total = 0, handled = 0;
    pm_status status =
        pm_transport_wait(pm_lockstep_coordinator_transport(coordinator), 0, &handled);
    if (status != PM_OK) {
        pm_lockstep_coordinator_fail(coordinator, status, pm_error());
    }
    total += handled;
    (void)pm_lockstep_coordinator_poll(coordinator, now);
    for (int i = 0; i < count; ++i) {
        status = pm_transport_wait(pm_lockstep_node_transport(node[i]), 0, &handled);
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
        over = over && pm_lockstep_node_leaving(node[i]);
    }
    return over;
}

pm_status pm_lockstep_run_together(pm_lockstep_coordinator *coordinator, int count,
                                   pm_lockstep_node *const *node,
                                   const volatile sig_atomic_t *stop) {
    const struct timespec idle = {0, (long)(1e9 * IDLE_INTERVAL)};
    while (!is_over(coordinator, count, node)) {
        if (is_set(stop)) {
            pm_lockstep_coordinator_fail(coordinator, PM_EINTERRUPTED, "interrupted");
        }
        if (take_turns(coordinator, count, node, pm_clock()) == 0) {
            nanosleep(&idle, NULL);
        }
    }
    return pm_lockstep_coordinator_result(coordinator);
}
