// The times at which a waiting process requests the missing message, in virtual time.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
// cmocka needs the above.
#include <cmocka.h>

#include "lockstep/waiting.h"

// Many waits of `seconds` each; the time at which the next one begins.
static double wait_often(pm_waiting *waiting, double seconds, double now) {
    for (int i = 0; i < 2 * PM_WAITING_LATELY; ++i) {
        pm_waiting_start(waiting, now);
        now += seconds;
    }
    pm_waiting_start(waiting, now);
    return now;
}

static void assert_asks_after(pm_waiting *waiting, double seconds, double now) {
    assert_false(pm_waiting_request_due(waiting, now + 0.9 * seconds));
    assert_true(pm_waiting_request_due(waiting, now + 1.1 * seconds));
}

// However short waits are: where nothing was lost a timer that is never needed costs as little as
// possible. Among many processes waits are long, and not taken for losses.
static void test_first_request(void **context) {
    (void)context;
    static const struct {
        int processes;
        double asks; // s
    } cases[] = {{1, PM_WAITING_FIRST}, {20, PM_WAITING_FIRST}, {64, 64 * PM_WAITING_EACH}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        pm_waiting waiting;
        pm_waiting_init(&waiting, cases[i].processes);
        assert_asks_after(&waiting, cases[i].asks, wait_often(&waiting, 1e-5, 100));
    }
}

// Waits for what was lost do not make each other longer and longer.
static void test_long_waits(void **context) {
    (void)context;
    pm_waiting waiting;
    pm_waiting_init(&waiting, 8);
    const double now = wait_often(&waiting, 1, 100);
    assert_asks_after(&waiting, PM_WAITING_FIRST, now);
    pm_waiting_start(&waiting, now + 1);
    assert_asks_after(&waiting, PM_WAITING_FIRST, now + 1);
}

// After a request short waits are trusted, for a while.
static void test_losses_make_wary(void **context) {
    (void)context;
    pm_waiting waiting;
    pm_waiting_init(&waiting, 2);
    double now = wait_often(&waiting, 1e-5, 100);
    assert_asks_after(&waiting, PM_WAITING_FIRST, now);
    now += 2 * PM_WAITING_FIRST;
    pm_waiting_start(&waiting, now);
    assert_asks_after(&waiting, PM_WAITING_SOONEST, now);
    now = wait_often(&waiting, 1e-5, now + PM_WAITING_SOONEST);
    assert_asks_after(&waiting, PM_WAITING_FIRST, now);
}

// Each request comes twice as late as the one before, up to the longest interval.
static void test_requests_back_off(void **context) {
    (void)context;
    pm_waiting waiting;
    pm_waiting_init(&waiting, 2);
    double now = wait_often(&waiting, 1e-5, 100);
    for (double interval = PM_WAITING_FIRST; !pm_waiting_is_long(&waiting); interval *= 2) {
        assert_asks_after(&waiting, interval, now);
        now += 1.1 * interval;
    }
    assert_asks_after(&waiting, PM_WAITING_LAST, now - 0.05 * PM_WAITING_LAST);
}

// Also among very many it is not the longest interval from the first.
static void test_crowds(void **context) {
    (void)context;
    pm_waiting waiting;
    pm_waiting_init(&waiting, 100000);
    const double now = wait_often(&waiting, 1e-5, 100);
    assert_false(pm_waiting_is_long(&waiting));
    assert_asks_after(&waiting, PM_WAITING_LAST / 2, now);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_first_request),    cmocka_unit_test(test_long_waits),
        cmocka_unit_test(test_losses_make_wary), cmocka_unit_test(test_requests_back_off),
        cmocka_unit_test(test_crowds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
