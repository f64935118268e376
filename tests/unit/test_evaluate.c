// Rollouts scored against datasets whose errors are known.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "evaluate/evaluate.h"
#include "evaluate/thermo.h"
#include "model/training_range.h"
#include "sim/monolithic.h"
#include "tests/support/fixture.h"

#define NTRAJECTORY 5
#define NTIME 12
#define NCOLUMN 10

static const char *const names[2][5] = {{"q1x", "q1y", "p1x", "p1y", "s1"},
                                        {"q2x", "q2y", "p2x", "p2y", "s2"}};
// The columns are not in the order of the scene, as in the public data.
static const char *const layout[NCOLUMN] = {"q1x", "q1y", "q2x", "q2y", "p1x",
                                            "p1y", "p2x", "p2y", "s1",  "s2"};

typedef struct bench {
    fixture f;
    pm_dataset *data;
} bench;

// Two links whose dataset holds absolute positions. Its trajectories are rollouts of these links,
// stored every `stride` steps.
static void bench_open(bench *b, int stride) {
    fixture_open(&b->f, 2, 3);
    pm_scene *scene = b->f.scene;
    scene->subsystem[0].column = names[0];
    scene->subsystem[1].column = names[1];
    scene->subsystem[1].relative_subsystem[0] = 0;
    scene->subsystem[1].relative_group[0] = 0;
    assert_int_equal(
        pm_dataset_new(&b->data, NTRAJECTORY, NTIME, NCOLUMN, stride * scene->dt, layout), PM_OK);
    pm_columns columns;
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_columns_bind(&columns, scene, b->data, &b->data->arena), PM_OK);
    assert_int_equal(pm_monolithic_open(&assembly, b->f.system), PM_OK);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        double z[NCOLUMN];
        for (int k = 0; k < NCOLUMN; ++k) {
            z[k] = b->f.z[k] + 0.1 * i;
        }
        pm_monolithic_set_state(assembly, z);
        pm_columns_to_row(&columns, z, pm_dataset_state(b->data, i, 0));
        for (int j = 1; j < NTIME; ++j) {
            for (int k = 0; k < stride; ++k) {
                assert_int_equal(pm_monolithic_step(assembly), PM_OK);
            }
            pm_columns_to_row(&columns, pm_monolithic_sample(assembly)->z,
                              pm_dataset_state(b->data, i, j));
        }
    }
    pm_monolithic_close(assembly);
}

static void bench_close(bench *b) {
    pm_dataset_free(b->data);
    fixture_close(&b->f);
}

static pm_evaluation *evaluate(const bench *b, int first, int end, int threads) {
    const pm_evaluate_how how = {.threads = threads};
    pm_evaluation *e = NULL;
    if (pm_evaluate(&e, b->f.system, b->data, first, end, &how) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return e;
}

static void assert_near(const char *what, double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance)) {
        fail_msg("%s: %.17g, expected %.17g within %g", what, value, expected, tolerance);
    }
}

static void own_trajectories_score_zero(void **state) {
    (void)state;
    for (int stride = 1; stride <= 3; stride += 2) {
        bench b = {.data = NULL};
        bench_open(&b, stride);
        pm_evaluation *e = evaluate(&b, 0, NTRAJECTORY, 2);
        assert_int_equal(e->stride, stride);
        assert_int_equal(e->columns.ngroup, 3);
        assert_int_equal(pm_evaluation_failures(e), 0);
        assert_null(pm_evaluation_violation(e));
        for (int i = 0; i < NTRAJECTORY; ++i) {
            assert_int_equal(e->rollout[i].trajectory, i);
            assert_int_equal(e->rollout[i].reached, NTIME);
            assert_int_equal(e->rollout[i].ledger.steps, stride * (NTIME - 1));
            for (int g = 0; g < 3; ++g) {
                assert_near("error", e->rollout[i].error[g], 0, 1e-12);
            }
        }
        for (int k = 0; k < NTRAJECTORY * NTIME * NCOLUMN; ++k) {
            assert_near("state", e->predicted->z[k], b.data->z[k], 1e-11);
        }
        pm_evaluation_free(e);
        bench_close(&b);
    }
}

// If the true p is (1 + d) times that of the rollout from state 1 on, the error of p is d / (1 +
// d).
static void errors_are_relative(void **state) {
    (void)state;
    const double d = 0.02;
    bench b = {.data = NULL};
    bench_open(&b, 1);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        for (int j = 1; j < NTIME; ++j) {
            for (int k = 4; k < 8; ++k) {
                pm_dataset_state(b.data, i, j)[k] *= 1 + d;
            }
        }
    }
    pm_evaluation *e = evaluate(&b, 0, NTRAJECTORY, 1);
    assert_string_equal(e->columns.group_name[1], "p");
    assert_near("q", e->snapshot[0].high, 0, 1e-12);
    assert_near("p, lowest", e->snapshot[1].low, d / (1 + d), 1e-12);
    assert_near("p, highest", e->snapshot[1].high, d / (1 + d), 1e-12);
    assert_near("p, mean", e->snapshot[1].mean, d / (1 + d), 1e-12);
    assert_near("first state", e->rollout[2].snapshot[1], 0, 1e-12);
    assert_true(e->trajectory[1].median > 0.5 * d && e->trajectory[1].median < d / (1 + d));
    pm_evaluation_free(e);
    bench_close(&b);
}

static void threads_change_nothing(void **state) {
    (void)state;
    bench b = {.data = NULL};
    bench_open(&b, 1);
    for (int k = 0; k < NTRAJECTORY * NTIME * NCOLUMN; ++k) {
        b.data->z[k] += 1e-3 * sin(k);
    }
    pm_evaluation *one = evaluate(&b, 0, NTRAJECTORY, 1);
    pm_evaluation *many = evaluate(&b, 0, NTRAJECTORY, 4);
    pm_evaluation *part = evaluate(&b, 2, 4, 2);
    assert_int_equal(part->count, 2);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        const size_t size = 3 * sizeof(double);
        assert_memory_equal(one->rollout[i].error, many->rollout[i].error, size);
        if (i >= 2 && i < 4) {
            assert_int_equal(part->rollout[i - 2].trajectory, i);
            assert_memory_equal(one->rollout[i].error, part->rollout[i - 2].error, size);
        }
    }
    assert_memory_equal(one->predicted->z, many->predicted->z,
                        NTRAJECTORY * NTIME * NCOLUMN * sizeof(double));
    assert_memory_equal(one->snapshot, many->snapshot, 3 * sizeof *one->snapshot);
    pm_evaluation_free(part);
    pm_evaluation_free(many);
    pm_evaluation_free(one);
    bench_close(&b);
}

static void a_failed_rollout_counts_as_infinite(void **state) {
    (void)state;
    bench b = {.data = NULL};
    bench_open(&b, 1);
    pm_dataset_state(b.data, 3, 0)[4] = 1e200; // its square overflows
    pm_evaluation *e = evaluate(&b, 0, NTRAJECTORY, 2);
    assert_int_equal(pm_evaluation_failures(e), 1);
    assert_int_equal(e->rollout[3].reached, 1);
    assert_true(isinf(e->rollout[3].error[0]) && isinf(e->rollout[3].snapshot[3 * (NTIME - 1)]));
    assert_true(isfinite(e->trajectory[0].median) && isinf(e->trajectory[0].mean));
    assert_memory_equal(pm_dataset_state(e->predicted, 3, NTIME - 1),
                        pm_dataset_state(e->predicted, 3, 0), NCOLUMN * sizeof(double));
    pm_evaluation_free(e);
    bench_close(&b);
}

// The first link was trained on its state at the start of trajectory 0 alone, the second on none.
static void steps_outside_the_training_range_are_counted(void **state) {
    (void)state;
    bench b = {.data = NULL};
    bench_open(&b, 1);
    pm_part *part = b.f.system->part[0];
    assert_int_equal(pm_training_range_declare(part), PM_OK);
    pm_training_range_widen(part, b.f.z);
    pm_evaluation *e = evaluate(&b, 0, 2, 1);
    for (int i = 0; i < e->count; ++i) {
        assert_int_equal(e->rollout[i].outside[0], NTIME - 1);
        assert_int_equal(e->rollout[i].outside[1], 0);
    }
    pm_evaluation_free(e);
    bench_close(&b);
}

static void violations_are_told(void **state) {
    (void)state;
    bench b = {.data = NULL};
    bench_open(&b, 1);
    b.f.scene->energy_tolerance = -1;
    pm_evaluation *e = evaluate(&b, 1, 3, 2);
    const pm_rollout *r = pm_evaluation_violation(e);
    assert_non_null(r);
    assert_non_null(strstr(r->violation, "trajectory 1: step 0"));
    pm_evaluation_free(e);
    bench_close(&b);
}

static void assert_fails(const bench *b, const pm_evaluate_how *how, pm_status code,
                         const char *words) {
    pm_evaluation *e = NULL;
    const pm_status status = pm_evaluate(&e, b->f.system, b->data, 0, 1, how);
    if (status != code || strstr(pm_error(), words) == NULL) {
        fail_msg("status %d, expected %d; \"%s\", expected \"%s\"", status, code, pm_error(),
                 words);
    }
    assert_null(e);
}

static void what_cannot_be_evaluated(void **state) {
    (void)state;
    bench b = {.data = NULL};
    bench_open(&b, 1);
    const volatile sig_atomic_t stop = 1;
    const pm_evaluate_how interrupted = {.threads = 2, .stop = &stop}, how = {.threads = 2};
    assert_fails(&b, &interrupted, PM_EINTERRUPTED, "interrupted");
    b.data->dt *= 1.5;
    assert_fails(&b, &how, PM_EDATA, "no multiple");
    b.data->dt /= 3;
    assert_fails(&b, &how, PM_EDATA, "no multiple");
    b.data->dt = b.f.scene->dt;
    b.data->ntime = 1;
    assert_fails(&b, &how, PM_EDATA, "leaves nothing to predict");
    b.data->ntime = NTIME;
    b.f.scene->subsystem[0].column = NULL;
    assert_fails(&b, &how, PM_ECONFIG, "maps no columns");
    bench_close(&b);
}

// The summary of many quantities names the worst of them.
static void many_rows_are_summarised(void **state) {
    (void)state;
    const pm_thermo_row row[3] = {
        {.kind = "power", .name = "a", .median = 1, .mean = 4, .largest = 9, .typical = 30},
        {.kind = "power", .name = "b", .median = 5, .mean = 6, .largest = 7, .typical = 10},
        {.kind = "power", .name = "c", .median = 2, .mean = 2, .largest = 2, .typical = 20}};
    pm_thermo_row sum, worst;
    assert_int_equal(pm_thermo_summarise(row, 3, &sum, &worst), PM_OK);
    assert_string_equal(sum.kind, "power");
    assert_near("median", sum.median, 2, 0);
    assert_near("mean", sum.mean, 4, 1e-15);
    assert_near("largest", sum.largest, 9, 0);
    assert_near("typical", sum.typical, 20, 0);
    assert_string_equal(worst.name, "b");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(many_rows_are_summarised),
        cmocka_unit_test(own_trajectories_score_zero),
        cmocka_unit_test(errors_are_relative),
        cmocka_unit_test(threads_change_nothing),
        cmocka_unit_test(a_failed_rollout_counts_as_infinite),
        cmocka_unit_test(steps_outside_the_training_range_are_counted),
        cmocka_unit_test(violations_are_told),
        cmocka_unit_test(what_cannot_be_evaluated),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
