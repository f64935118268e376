// A failed step is not taken: after it, a run has the bits of one that never failed. The failures
// are those of every subsystem at every stage, of a guard after the books are closed, and of a
// trajectory that is over.
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "library/local_run.h"
#include "tests/support/row_of_bodies.h"
#include "tests/support/unit.h"

#define SMALLEST 20 // powers of ten of the inputs that make a step fail
#define LARGEST 308

static const char scene_text[] =
    PM_ROW_OF_BODIES("  hand2: {f: {unit: m, dE: [0.0, 0.3]}}\n",
                     "  push2:\n"
                     "    {law: bracket, between: [body2, hand2], model: push,\n"
                     "     expose: {body2: p, hand2: f}}\n");

typedef struct trial {
    pm_setup setup;
    pm_local_run run;
    double *held; // [nprescribed]
} trial;

static void open_trial(trial *t, pm_scene *scene) {
    *t = (trial){0};
    if (pm_setup_open(&t->setup, scene, NULL) != PM_OK ||
        pm_setup_complete(&t->setup, PM_TO_SERVE) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    const int n = scene->physics.nprescribed;
    t->held = pm_arena_array(&t->setup.arena, (size_t)n + 1, sizeof *t->held);
    for (int i = 0; i < n; ++i) {
        t->held[i] = NAN;
    }
    t->setup.boundary_input.held = t->held;
    if (pm_local_run_open(&t->run, &t->setup, PM_LOCAL_UNDO) != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

static void close_trial(trial *t) {
    pm_local_run_close(&t->run);
    pm_setup_free(&t->setup);
}

static void step_well(trial *t) {
    if (pm_local_run_step(&t->run) != PM_OK) {
        fail_msg("step %ld: %s", t->run.sample.step + 1, pm_error());
    }
}

// Fails unless both runs have the same state, books, counts and totals, bit by bit.
static void assert_same(const trial *a, const trial *b, const char *what) {
    const pm_sample *x = &a->run.sample, *y = &b->run.sample;
    const pm_physics *physics = &a->setup.scene->physics;
    const size_t n = (size_t)physics->nsubsystem;
#define SAME(member, count)                                                       \
    if (memcmp(x->member, y->member, (size_t)(count) * sizeof *x->member) != 0) { \
        fail_msg("%s: " #member " differs at step %ld", what, x->step);           \
    }
#define SAME_NUMBER(type, name, series, unit) SAME(name, n)
#define SAME_BULK(member, name, series, unit) SAME(name, n)
    SAME(z, physics->nz)
    PM_SUBSYSTEM_NUMBERS(SAME_NUMBER, SAME_BULK)
    SAME(flux, physics->nport)
    const pm_ledger *l = &a->run.ledger, *m = &b->run.ledger;
    const double totals[2][8] = {
        {l->energy, l->entropy, l->energy_drift, l->outside_energy, l->outside_entropy,
         l->worst_energy, l->worst_entropy, l->worst_step},
        {m->energy, m->entropy, m->energy_drift, m->outside_energy, m->outside_entropy,
         m->worst_energy, m->worst_entropy, m->worst_step}};
    assert_memory_equal(totals[0], totals[1], sizeof totals[0]);
    if (x->step != y->step || x->time != y->time || l->violations != m->violations ||
        l->unbalanced != m->unbalanced || x->outside_energy != y->outside_energy ||
        x->evaluated_in_all != y->evaluated_in_all || x->skipped_in_all != y->skipped_in_all) {
        fail_msg("%s: step %ld and %ld, %ld and %ld skipped", what, x->step, y->step,
                 x->skipped_in_all, y->skipped_in_all);
    }
}

static void open_both(trial both[2], const char *time) {
    char text[4096];
    for (int i = 0; i < 2; ++i) {
        pm_scene *scene = NULL;
        snprintf(text, sizeof text, scene_text, time);
        if (pm_scene_parse(&scene, text, "row.yaml") != PM_OK) {
            fail_msg("%s", pm_error());
        }
        open_trial(&both[i], scene);
    }
}

// Makes one step of the first run fail, and then takes two steps of both.
static int fail_and_go_on(trial both[2], const char *what) {
    const pm_status status = pm_local_run_step(&both[0].run);
    for (int i = 0; i < both[0].setup.scene->physics.nprescribed; ++i) {
        both[0].held[i] = NAN;
    }
    if (status == PM_OK) { // the second run does as the first one has done
        return 0;
    }
    assert_same(&both[0], &both[1], what);
    for (int i = 0; i < 2; ++i) {
        step_well(&both[0]);
        step_well(&both[1]);
        assert_same(&both[0], &both[1], what);
    }
    return 1;
}

static const char *const methods[] = {
    "integrator: rk4, substeps: 2", "integrator: rk4_balanced, substeps: 3",
    "integrator: discrete_gradient, substeps: 2", "integrator: heun, tolerance: 1.0e-5"};

// A force on one body that is too large for floating point makes this body fail first, the sooner
// the larger it is.
static void any_subsystem_may_fail_at_any_stage(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof methods / sizeof *methods; ++i) {
        int failures = 0;
        for (int body = 0; body < 3; ++body) {
            trial both[2];
            open_both(both, methods[i]);
            for (int k = 0; k < 3; ++k) {
                step_well(&both[0]);
                step_well(&both[1]);
            }
            for (int power = LARGEST; power >= SMALLEST; power -= 9) {
                char what[128];
                snprintf(what, sizeof what, "%s: force 1e%d on body %d", methods[i], power, body);
                both[0].held[6 * body + 2] = pow(10, power);
                const int failed = fail_and_go_on(both, what);
                failures += failed;
                if (failed == 0) {
                    break;
                }
            }
            close_trial(&both[0]);
            close_trial(&both[1]);
        }
        assert_in_range(failures, 12, 1000);
    }
}

// The guard on the drift of the energy ends a step after its books are closed.
static void a_step_may_fail_after_its_books(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof methods / sizeof *methods; ++i) {
        trial both[2];
        open_both(both, methods[i]);
        for (int k = 0; k < 5; ++k) {
            both[0].setup.scene->run.largest_drift = -1;
            assert_int_equal(pm_local_run_step(&both[0].run), PM_ENUMERIC);
            assert_int_equal(pm_local_run_step(&both[0].run), PM_ENUMERIC);
            assert_same(&both[0], &both[1], methods[i]);
            both[0].setup.scene->run.largest_drift = INFINITY;
            step_well(&both[0]);
            step_well(&both[1]);
            assert_same(&both[0], &both[1], methods[i]);
        }
        close_trial(&both[0]);
        close_trial(&both[1]);
    }
}

// A step beyond the trajectory that an input follows has seen values that nobody prescribes.
static void a_trajectory_may_end(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof methods / sizeof *methods; ++i) {
        trial both[2];
        open_both(both, methods[i]);
        step_well(&both[0]);
        step_well(&both[1]);
        both[0].setup.boundary_input.column[1] = 0; // a column, which ends after one step
        both[0].setup.boundary_input.end = 1;
        assert_int_equal(pm_local_run_step(&both[0].run), PM_EDATA);
        both[0].setup.boundary_input.column[1] = PM_BOUNDARY_INPUT_CONSTANT;
        both[0].setup.boundary_input.end = LONG_MAX;
        for (int k = 0; k < 2; ++k) {
            assert_same(&both[0], &both[1], methods[i]);
            step_well(&both[0]);
            step_well(&both[1]);
        }
        close_trial(&both[0]);
        close_trial(&both[1]);
    }
}

// Two solids in contact, with a gap that remembers how the bodies give way.
static void solids_forget_a_failed_step(void **state) {
    (void)state;
    trial both[2];
    for (int i = 0; i < 2; ++i) {
        pm_scene *scene = NULL;
        assert_int_equal(pm_scene_load(&scene, "configs/crossed_solids.yaml"), PM_OK);
        open_trial(&both[i], scene);
    }
    for (int k = 0; k < 4; ++k) {
        both[0].setup.scene->run.largest_drift = -1;
        assert_int_equal(pm_local_run_step(&both[0].run), PM_ENUMERIC);
        both[0].setup.scene->run.largest_drift = INFINITY;
        step_well(&both[0]);
        step_well(&both[1]);
        assert_same(&both[0], &both[1], "two solids");
    }
    close_trial(&both[0]);
    close_trial(&both[1]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_subsystem_may_fail_at_any_stage),
        cmocka_unit_test(a_step_may_fail_after_its_books),
        cmocka_unit_test(a_trajectory_may_end),
        cmocka_unit_test(solids_forget_a_failed_step),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
