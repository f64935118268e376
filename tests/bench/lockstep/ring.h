// Rings of processes without a model, for comparison. In each step a process tells both neighbours
// that it has reached the step, and waits until both have reached it.
#ifndef TESTS_BENCH_RING_H
#define TESTS_BENCH_RING_H

#include "base/status.h"
#include "cost.h"

typedef enum ring_kind {
    RING_LCM,  // messages of 72 bytes, liblcm alone
    RING_OWN,  // published by liblcm, received by transport/transport_lcm.c
    RING_FUTEX // counters in shared memory
} ring_kind;

// Runs `count` processes, at most 64, for `steps` steps on LCM at `url`. PM_ENET: a process failed,
// or a message was lost.
pm_status ring_run(ring_kind kind, const char *url, int count, int steps, cost *result);

#endif
