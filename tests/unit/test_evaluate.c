// Rollouts scored against datasets whose errors are known.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "evaluate/evaluate.h"
#include "evaluate/thermo.h"
#include "model/training_range.h"
#include "sim/monolithic.h"
#include "tests/support/fixture.h"
#include "tests/support/unit.h"

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
    scene->physics.subsystem[0].column = names[0];
    scene->physics.subsystem[1].column = names[1];
    scene->physics.subsystem[1].relative_subsystem[0] = 0;
    scene->physics.subsystem[1].relative_group[0] = 0;
    assert_int_equal(
        pm_dataset_new(&b->data, NTRAJECTORY, NTIME, NCOLUMN, stride * scene->physics.dt, layout),
        PM_OK);
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
    // Persistence, and the same error relative to the deviation from the mean, of one trajectory.
    e = evaluate(&b, 2, 3, 1);
    double square = 0, still = 0, about = 0;
    for (int k = 4; k < 8; ++k) {
        double mean = 0;
        for (int j = 0; j < NTIME; ++j) {
            mean += pm_dataset_state(b.data, 2, j)[k] / NTIME;
        }
        for (int j = 0; j < NTIME; ++j) {
            const double x = pm_dataset_state(b.data, 2, j)[k];
            const double first = pm_dataset_state(b.data, 2, 0)[k];
            square += x * x;
            still += (x - first) * (x - first);
            about += (x - mean) * (x - mean);
        }
    }
    assert_near("persistence", e->persistence[1], sqrt(still / square), 1e-12);
    assert_near("of the deviation", e->of_deviation[1],
                e->rollout[0].error[1] * sqrt(square / about), 1e-12);
    pm_evaluation_free(e);
    bench_close(&b);
}

// A closed system keeps its energy. If the model's energy rises along the true states by a part of
// the heat produced, its temperatures are too high by this part.
static void the_balance_of_energy_shows_wrong_temperatures(void **state) {
    (void)state;
    bench b = {.data = NULL};
    bench_open(&b, 1);
    pm_evaluation *e = evaluate(&b, 0, NTRAJECTORY, 1);
    const int last = NTIME - 1, npart = 2;
    for (int kind = 0; kind < 3; ++kind) {
        for (int i = 0; i < NTRAJECTORY; ++i) {
            pm_rollout *r = &e->rollout[i];
            double *energy = r->part_energy + npart * (NTIME + last);
            double *entropy = r->part_entropy + npart * (NTIME + last);
            const double sign = kind == 2 && i % 2 == 1 ? -1 : 1, produced = 1 + i;
            for (int p = 0; p < npart; ++p) { // half of it each
                energy[p] = r->part_energy[npart * NTIME + p] + 0.5 * 0.1 * sign * 300 * produced;
                entropy[p] = r->part_entropy[npart * NTIME + p] + 0.5 * produced;
            }
            r->coldest = kind == 1 ? -280 : 280; // not positive: not known
            r->warmest = 320;
        }
        pm_thermo t;
        assert_int_equal(pm_thermo_make(&t, e), PM_OK);
        if (kind == 1) {
            assert_true(isnan(t.warmer));
        } else { // as often too high as too low: not a matter of temperatures
            assert_near("excess of temperatures", t.warmer, kind == 0 ? 0.1 : 0, 1e-9);
        }
        pm_thermo_free(&t);
    }
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
        assert_int_equal(e->rollout[i].nout_of_range[0], NTIME - 1);
        assert_int_equal(e->rollout[i].nout_of_range[1], 0);
    }
    pm_evaluation_free(e);
    bench_close(&b);
}

static void violations_are_told(void **state) {
    (void)state;
    bench b = {.data = NULL};
    bench_open(&b, 1);
    b.f.scene->run.energy_tolerance = -1;
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
    b.data->dt = b.f.scene->physics.dt;
    b.data->ntime = 1;
    assert_fails(&b, &how, PM_EDATA, "leaves nothing to predict");
    b.data->ntime = NTIME;
    b.f.scene->physics.subsystem[0].column = NULL;
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

// --- units of entropies ---

// Two warm bodies with friction that exchange heat; `unit` is that of their entropies, `kilo` how
// many J/K it is.
static void load_warm_bodies(pm_scene **scene, pm_system **system, const char *unit, double kilo) {
    char text[2048];
    snprintf(text, sizeof text,
             "scene: warm\n"
             "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 2}\n"
             "models:\n"
             "  body:\n"
             "    energy: [\"|p|^2/2 + |q|^2/2\", \"900*exp(u*s/3)\"]\n"
             "    constants: {u: %.17g}\n"
             "    entropy: {given: {s: %.17g}}\n"
             "    reversible: {given: [[q, p, 1.0]]}\n"
             "    irreversible: {given: [[p, s, 40.0]]}\n"
             "  heat: {law: bracket, irreversible: {given: [[a.s, b.s, %.17g]]}}\n"
             "subsystems:\n"
             "  a: {model: body, state: {q: {unit: m, columns: qa}, p: {unit: kg m/s,\n"
             "      columns: pa}, s: {unit: %s, columns: sa}}}\n"
             "  b: {model: body, state: {q: {unit: m, columns: qb}, p: {unit: kg m/s,\n"
             "      columns: pb}, s: {unit: %s, columns: sb}}}\n"
             "ports:\n"
             "  wall: {law: bracket, between: [a, b], expose: {a: s, b: s}, model: heat}\n",
             kilo, kilo, 0.5 / (kilo * kilo), unit, unit);
    if (pm_scene_parse(scene, text, "warm.yaml") != PM_OK ||
        pm_system_load(system, *scene, NULL) != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

static void assert_same(const char *what, double value, double expected) {
    assert_near(what, value, expected, 1e-6 * fabs(expected) + 1e-12);
}

// The same bodies with entropies in J/K and in kJ/K: the temperatures and every other
// thermodynamic quantity of the report are equal.
static void units_of_entropies_change_no_report(void **state) {
    (void)state;
    static const char *const column[] = {"qa", "pa", "sa", "qb", "pb", "sb"};
    static const char *const unit[2] = {"J/K", "kJ/K"};
    enum { NSTATE = 6 };
    pm_scene *scene[2] = {NULL};
    pm_system *system[2] = {NULL};
    pm_dataset *data[2] = {NULL};
    pm_evaluation *e[2] = {NULL};
    pm_thermo thermo[2];
    for (int k = 0; k < 2; ++k) {
        const double kilo = k == 0 ? 1 : 1000;
        const pm_evaluate_how how = {.threads = 1};
        load_warm_bodies(&scene[k], &system[k], unit[k], kilo);
        assert_int_equal(pm_dataset_new(&data[k], 3, NTIME, NSTATE, 0.05, column), PM_OK);
        for (int i = 0; i < 3 * NTIME; ++i) { // no solutions, so that all errors are finite
            double *z = pm_dataset_state(data[k], i / NTIME, i % NTIME);
            for (int c = 0; c < NSTATE; ++c) {
                z[c] = 0.3 + 0.2 * c + 0.1 * (i / NTIME) + 0.02 * (i % NTIME);
                z[c] /= c % 3 == 2 ? kilo : 1;
            }
        }
        if (pm_evaluate(&e[k], system[k], data[k], 0, 3, &how) != PM_OK) {
            fail_msg("%s", pm_error());
        }
        assert_int_equal(pm_thermo_make(&thermo[k], e[k]), PM_OK);
    }
    assert_true(thermo[0].coldest > 300 && thermo[0].warmest > thermo[0].coldest);
    assert_same("coldest", thermo[1].coldest, thermo[0].coldest);
    assert_same("warmest", thermo[1].warmest, thermo[0].warmest);
    assert_int_equal(thermo[1].count, thermo[0].count);
    for (int i = 0; i < thermo[0].count; ++i) {
        const pm_thermo_row *one = &thermo[0].row[i], *other = &thermo[1].row[i];
        assert_string_equal(other->kind, one->kind);
        assert_same(one->kind, other->median, one->median);
        assert_same(one->kind, other->largest, one->largest);
        assert_same(one->kind, other->bias, one->bias);
        assert_same(one->kind, other->typical, one->typical);
    }
    assert_int_equal(e[1]->columns.ngroup, e[0]->columns.ngroup);
    for (int g = 0; g < e[0]->columns.ngroup; ++g) {
        assert_same("error", e[1]->trajectory[g].median, e[0]->trajectory[g].median);
    }
    for (int k = 0; k < 2; ++k) {
        pm_thermo_free(&thermo[k]);
        pm_evaluation_free(e[k]);
        pm_dataset_free(data[k]);
        pm_system_free(system[k]);
        pm_scene_free(scene[k]);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(many_rows_are_summarised),
        cmocka_unit_test(own_trajectories_score_zero),
        cmocka_unit_test(errors_are_relative),
        cmocka_unit_test(the_balance_of_energy_shows_wrong_temperatures),
        cmocka_unit_test(threads_change_nothing),
        cmocka_unit_test(a_failed_rollout_counts_as_infinite),
        cmocka_unit_test(steps_outside_the_training_range_are_counted),
        cmocka_unit_test(violations_are_told),
        cmocka_unit_test(what_cannot_be_evaluated),
        cmocka_unit_test(units_of_entropies_change_no_report),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
