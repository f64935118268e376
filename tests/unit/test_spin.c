// Polling and sleeping of waits, in virtual time.
#include <stdbool.h>

#include "tests/support/unit.h"
#include "transport/spin.h"

#define SHORT (0.5 * PM_SPIN_LONGEST)
#define SLICE (3 * PM_SPIN_SLICE)

static void assert_spins(const pm_spin *spin, double now, bool expected) {
    assert_true(pm_spin_time(spin, now) == (expected ? PM_SPIN_LONGEST : 0));
}

static void test_long_waits_are_slept_through(void **context) {
    (void)context;
    pm_spin spin = {0};
    assert_spins(&spin, 100, true);
    pm_spin_note_wait(&spin, 2 * PM_SPIN_LONGEST);
    assert_spins(&spin, 100, false);
    int count = 0; // a single long one is forgotten after some
    while (pm_spin_time(&spin, 100) == 0 && count < 20) {
        pm_spin_note_wait(&spin, SHORT);
        ++count;
    }
    assert_in_range(count, 2, 19);
}

static void test_quick_yields_change_nothing(void **context) {
    (void)context;
    pm_spin spin = {0};
    for (int i = 0; i < 1000; ++i) {
        pm_spin_note_yield(&spin, 0.9 * PM_SPIN_SLICE, 100 + i);
    }
    assert_spins(&spin, 1100, true);
}

// Each loss soon after the pause doubles it, up to the longest; one after a good while does not.
static void test_lost_slices_pause_for_longer_and_longer(void **context) {
    (void)context;
    pm_spin spin = {0};
    double now = 100, pause = PM_SPIN_FIRST_PAUSE;
    for (int i = 0; i < 20; ++i) {
        pm_spin_note_yield(&spin, SLICE, now);
        assert_spins(&spin, now + 0.99 * pause, false);
        assert_spins(&spin, now + 1.01 * pause, true);
        now += 1.01 * pause;
        pause = 2 * pause < PM_SPIN_LONGEST_PAUSE ? 2 * pause : PM_SPIN_LONGEST_PAUSE;
    }
    now += 2 * PM_SPIN_LONGEST_PAUSE;
    pm_spin_note_yield(&spin, SLICE, now);
    assert_spins(&spin, now + 0.99 * PM_SPIN_FIRST_PAUSE, false);
    assert_spins(&spin, now + 1.01 * PM_SPIN_FIRST_PAUSE, true);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_long_waits_are_slept_through),
        cmocka_unit_test(test_quick_yields_change_nothing),
        cmocka_unit_test(test_lost_slices_pause_for_longer_and_longer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
