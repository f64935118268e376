// What columns are between their samples: staircases, lines, curves and noise of many sizes.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "data/hold.h"
#include "tests/support/unit.h"

#define TRACKS 3
#define SAMPLES 200
#define SEEDS 20

typedef double (*column)(pm_rng *rng, int j, double t, double before);

static double levels(pm_rng *rng, int j, double t, double before) {
    (void)t;
    return j % 7 == 0 ? pm_rng_uniform(rng) : before;
}

static double every_sample(pm_rng *rng, int j, double t, double before) {
    (void)j, (void)t, (void)before;
    return pm_rng_normal(rng);
}

static double one_step(pm_rng *rng, int j, double t, double before) {
    (void)t, (void)before;
    (void)rng;
    return j < SAMPLES / 3 ? 2 : 5;
}

static double rare_with_noise(pm_rng *rng, int j, double t, double before) {
    (void)t;
    const double level = j == 0 ? 0 : round(before);
    return (j % 40 == 39 ? round(8 * pm_rng_uniform(rng)) : level) + 0.01 * pm_rng_normal(rng);
}

static double two_levels(pm_rng *rng, int j, double t, double before) {
    (void)t;
    return j == 0 || pm_rng_uniform(rng) < 0.05 ? (before > 0 ? -1 : 1) : before;
}

static double curve(pm_rng *rng, int j, double t, double before) {
    (void)rng, (void)j, (void)before;
    return sin(3 * t) + 0.3 * cos(7 * t + 1);
}

static double few_samples(pm_rng *rng, int j, double t, double before) {
    (void)rng, (void)j, (void)before;
    return sin(18 * t); // seven samples in a period
}

static double decay(pm_rng *rng, int j, double t, double before) {
    (void)rng, (void)j, (void)before;
    return 290 + 10 * exp(-t);
}

static double noisy_curve(pm_rng *rng, int j, double t, double before) {
    (void)j, (void)before;
    return sin(0.5 * t) + 0.01 * pm_rng_normal(rng);
}

static double triangle(pm_rng *rng, int j, double t, double before) {
    (void)rng, (void)t, (void)before;
    const int k = j % 40;
    return k < 20 ? k : 40 - k;
}

static double still(pm_rng *rng, int j, double t, double before) {
    (void)rng, (void)j, (void)t, (void)before;
    return 3;
}

static void check(const char *what, column f, pm_hold expected) {
    static const char *const name[] = {"x"};
    for (uint64_t seed = 1; seed <= SEEDS; ++seed) {
        const bool uneven = seed % 2 == 0, gaps = seed % 3 == 0;
        pm_dataset *d = NULL;
        pm_hold hold = PM_HOLD_SMOOTH;
        assert_int_equal(pm_dataset_new(&d, TRACKS, SAMPLES, 1, 0.05, name), PM_OK);
        d->times = pm_arena_array(&d->arena, TRACKS * SAMPLES, sizeof *d->times);
        for (int i = 0; i < TRACKS; ++i) {
            pm_rng rng;
            pm_rng_init(&rng, seed, (uint64_t)i);
            double y = 0;
            for (int j = 0; j < SAMPLES; ++j) {
                const double t = 0.05 * (j + (uneven ? 0.2 * pm_rng_uniform(&rng) : 0));
                d->times[i * SAMPLES + j] = t;
                y = f(&rng, j, t, y);
                *pm_dataset_state(d, i, j) = gaps && j % 17 == 5 ? (double)NAN : y;
            }
        }
        assert_int_equal(pm_hold_of_column(d, 0, &hold), PM_OK);
        if (hold != expected) {
            fail_msg("%s, seed %d: found %s, expected %s", what, (int)seed, pm_hold_names[hold],
                     pm_hold_names[expected]);
        }
        pm_dataset_free(d);
    }
}

static void staircases_are_held(void **state) {
    (void)state;
    check("levels", levels, PM_HOLD_PREVIOUS);
    check("a level for each sample", every_sample, PM_HOLD_PREVIOUS);
    check("one step", one_step, PM_HOLD_PREVIOUS);
    check("rare steps with noise", rare_with_noise, PM_HOLD_PREVIOUS);
    check("two levels", two_levels, PM_HOLD_PREVIOUS);
}

static void curves_and_lines_are_none(void **state) {
    (void)state;
    check("sines", curve, PM_HOLD_SMOOTH);
    check("few samples of a sine", few_samples, PM_HOLD_SMOOTH);
    check("decay", decay, PM_HOLD_SMOOTH);
    check("still", still, PM_HOLD_SMOOTH);
    check("noise", noisy_curve, PM_HOLD_LINEAR);
}

static void kinks_are_joined_by_lines(void **state) {
    (void)state;
    static const char *const name[] = {"x"};
    pm_dataset *d = NULL;
    pm_hold hold = PM_HOLD_SMOOTH;
    assert_int_equal(pm_dataset_new(&d, 1, SAMPLES, 1, 0.05, name), PM_OK);
    for (int j = 0; j < SAMPLES; ++j) {
        *pm_dataset_state(d, 0, j) = triangle(NULL, j, 0, 0);
    }
    assert_int_equal(pm_hold_of_column(d, 0, &hold), PM_OK);
    assert_int_equal(hold, PM_HOLD_LINEAR);
    pm_dataset_free(d);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(staircases_are_held),
        cmocka_unit_test(curves_and_lines_are_none),
        cmocka_unit_test(kinks_are_joined_by_lines),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
