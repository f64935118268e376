// Scores: relative errors per group worked out by hand, and box plots of known samples.
#include <math.h>

#include "sim/score.h"
#include "tests/support/unit.h"

// Columns 0 and 3 are group 0, column 2 is group 1, column 1 is not mapped.
static int column[3] = {3, 2, 0}, group[3] = {0, 1, 0};
static const pm_columns columns = {.nz = 3, .column = column, .group = group, .ngroup = 2};

static void assert_rounds_to(double value, double expected) {
    const double tolerance = 1e-14; // a few roundings of numbers of order 1
    if (!(fabs(value - expected) <= tolerance)) {
        fail_msg("%.17g, expected %.17g within %g", value, expected, tolerance);
    }
}

static void errors_are_relative_per_group(void **state) {
    (void)state;
    const double truth[2][4] = {{3, 9, 2, 4}, {0, 9, 0, 12}};
    const double predicted[2][4] = {{3, -9, 2.5, 4.5}, {1.2, -9, 0.25, 12}};
    double trajectory[2], snapshot[2][2];
    pm_score(&columns, 2, 4, predicted[0], truth[0], trajectory, snapshot[0]);
    assert_rounds_to(trajectory[0], sqrt(0.25 + 1.44) / 13);
    assert_rounds_to(trajectory[1], sqrt(0.25 + 0.0625) / 2);
    assert_rounds_to(snapshot[0][0], 0.5 / 5);
    assert_rounds_to(snapshot[0][1], 0.5 / 2);
    assert_rounds_to(snapshot[1][0], 1.2 / 12);
    assert_rounds_to(snapshot[1][1], 0.25 / sqrt(2)); // zero in truth: relative to the mean square
    double alone[2];
    pm_score(&columns, 2, 4, predicted[0], truth[0], alone, NULL);
    assert_memory_equal(alone, trajectory, sizeof alone);
    pm_score_sums sums = {0};
    pm_score_add(&columns, 0, predicted[0], truth[0], &sums);
    pm_score_add(&columns, 0, predicted[1], truth[1], &sums);
    assert_true(pm_score_of(&sums) == trajectory[0]);
}

// What is zero beside the rest, but for rounding, does not make an error large.
static void snapshots_of_rounding_size_count_as_zero(void **state) {
    (void)state;
    const double truth[3][4] = {{0, 0, 1, 0}, {0, 0, 1e-12, 0}, {0, 0, 1e-8, 0}};
    const double predicted[3][4] = {{0.5, 0, 1, 0}, {0, 0, 0.25, 0}, {0, 0, 2e-8, 0}};
    double trajectory[2], snapshot[3][2];
    pm_score(&columns, 3, 4, predicted[0], truth[0], trajectory, snapshot[0]);
    assert_rounds_to(snapshot[1][1], (0.25 - 1e-12) * sqrt(3));
    assert_rounds_to(snapshot[2][1], 1);
    assert_rounds_to(snapshot[0][0], 0.5); // zero throughout: the absolute norm
}

static void a_failed_prediction_scores_nan(void **state) {
    (void)state;
    const double truth[4] = {1, 1, 1, 1}, predicted[4] = {NAN, 1, 1.5, 1};
    double trajectory[2];
    pm_score(&columns, 1, 4, predicted, truth, trajectory, NULL);
    assert_true(isnan(trajectory[0]));
    assert_rounds_to(trajectory[1], 0.5);
}

static void box_has_interpolated_quartiles_and_whiskers_within_reach(void **state) {
    (void)state;
    double value[] = {9, 1, 3, 2, 30, 4, 5, 7};
    const pm_box box = pm_box_of(8, value);
    assert_rounds_to(box.first_quartile, 2.75);
    assert_rounds_to(box.median, 4.5);
    assert_rounds_to(box.third_quartile, 7.5);
    assert_rounds_to(box.low, 1);
    assert_rounds_to(box.high, 9); // 30 lies beyond 7.5 + 1.5 * 4.75
    assert_rounds_to(box.mean, 61.0 / 8);
    assert_rounds_to(value[0], 1);
    assert_rounds_to(value[7], 30);
}

static void box_of_one_value_is_that_value(void **state) {
    (void)state;
    double value = 3;
    const pm_box box = pm_box_of(1, &value);
    const double all[] = {box.low, box.first_quartile, box.median, box.third_quartile, box.high,
                          box.mean};
    for (int i = 0; i < 6; ++i) {
        assert_rounds_to(all[i], 3);
    }
}

static void failed_rollouts_count_as_the_worst(void **state) {
    (void)state;
    double value[] = {NAN, 2, INFINITY, 1, NAN, 3, 4};
    const pm_box box = pm_box_of(7, value);
    assert_rounds_to(box.first_quartile, 2.5);
    assert_rounds_to(box.median, 4);
    assert_true(isnan(box.third_quartile));
    assert_true(isnan(box.mean));
    assert_true(isinf(value[4]));
    assert_true(isnan(value[6]));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(errors_are_relative_per_group),
        cmocka_unit_test(snapshots_of_rounding_size_count_as_zero),
        cmocka_unit_test(a_failed_prediction_scores_nan),
        cmocka_unit_test(box_has_interpolated_quartiles_and_whiskers_within_reach),
        cmocka_unit_test(box_of_one_value_is_that_value),
        cmocka_unit_test(failed_rollouts_count_as_the_worst),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
