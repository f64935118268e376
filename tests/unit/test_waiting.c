// The times at which a waiting process requests the missing message, in virtual time.
#include "lockstep/endpoint.h"
#include "tests/support/unit.h"

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
    } cases[] = {{1, PM_WAITING_FIRST},
                 {10, PM_WAITING_FIRST},
                 {64, 64 * PM_WAITING_EACH + 64 * 64 * PM_WAITING_PAIR}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        pm_waiting waiting;
        pm_waiting_init(&waiting, cases[i].processes, 1);
        assert_asks_after(&waiting, cases[i].asks, wait_often(&waiting, 1e-5, 100));
    }
}

// Waits for what was lost do not make each other longer and longer.
static void test_long_waits(void **context) {
    (void)context;
    pm_waiting waiting;
    pm_waiting_init(&waiting, 8, 1);
    const double now = wait_often(&waiting, 1, 100);
    assert_asks_after(&waiting, PM_WAITING_FIRST, now);
    pm_waiting_start(&waiting, now + 1);
    assert_asks_after(&waiting, PM_WAITING_FIRST, now + 1);
}

// After a request short waits are trusted, for a while.
static void test_losses_make_wary(void **context) {
    (void)context;
    pm_waiting waiting;
    pm_waiting_init(&waiting, 2, 1);
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
    pm_waiting_init(&waiting, 2, 1);
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
    pm_waiting_init(&waiting, 100000, 1);
    const double now = wait_often(&waiting, 1e-5, 100);
    assert_false(pm_waiting_is_long(&waiting));
    assert_asks_after(&waiting, PM_WAITING_MOST, now);
}

// Sends requests whenever they are due, while each of many waits takes `seconds`; returns their
// number.
static int ask_often(pm_waiting *waiting, int waits, double seconds, bool used) {
    int requests = 0;
    double now = 100;
    for (int i = 0; i < waits; ++i, now += seconds) {
        pm_waiting_start(waiting, now);
        while (waiting->next < now + seconds) {
            if (pm_waiting_request_due(waiting, waiting->next)) {
                pm_waiting_note_requests(waiting, 1);
                ++requests;
            }
        }
        if (used) {
            pm_waiting_note_used(waiting);
        }
    }
    return requests;
}

// On a machine that is slower than all timers, requests stay a small part of the traffic: a part of
// the messages, and what all processes together may send with time.
static void test_requests_are_bounded(void **context) {
    (void)context;
    const int processes = 500, waits = 2000;
    const double seconds = 1;
    pm_waiting waiting;
    pm_waiting_init(&waiting, processes, processes);
    const double slow = waits * seconds / (PM_WAITING_REFILL * processes);
    assert_in_range(ask_often(&waiting, waits, seconds, false), 1, (uintmax_t)slow + 1);
    pm_waiting_init(&waiting, processes, processes);
    assert_in_range(ask_often(&waiting, waits, seconds, true), (uintmax_t)slow,
                    (uintmax_t)(slow + PM_WAITING_SHARE * waits) + 1);
}

// One message in sixteen may be lost without any other wait than that for the first request.
static void test_losses_are_paid(void **context) {
    (void)context;
    const double seconds = 1e-5;
    pm_waiting waiting;
    pm_waiting_init(&waiting, 500, 500);
    double now = 100;
    for (int i = 0; i < 1000; ++i) {
        pm_waiting_start(&waiting, now);
        now += seconds;
        if (i % 20 == 19) { // lost
            assert_true(pm_waiting_request_due(&waiting, now = waiting.next));
            pm_waiting_note_requests(&waiting, 1);
        }
        pm_waiting_note_used(&waiting);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_first_request),    cmocka_unit_test(test_long_waits),
        cmocka_unit_test(test_losses_make_wary), cmocka_unit_test(test_requests_back_off),
        cmocka_unit_test(test_crowds),           cmocka_unit_test(test_requests_are_bounded),
        cmocka_unit_test(test_losses_are_paid),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
