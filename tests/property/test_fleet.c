// Copies of a scene (library/fleet.h) have the bits of runs alone: for any number of copies and
// threads, for every kind of integrator, with inputs of their own, after copies that failed,
// rested, or were saved and restored.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/rng.h"
#include "library/fleet.h"
#include "library/local_run.h"
#include "tests/support/row_of_bodies.h"

#define NZ 15
#define BODIES 3

static const char scene_text[] = PM_ROW_OF_BODIES("", "");

static const char *const methods[] = {
    "integrator: rk4, substeps: 2", "integrator: euler", "integrator: rk4_balanced, substeps: 3",
    "integrator: discrete_gradient, substeps: 2", "integrator: heun, tolerance: 1.0e-5"};
#define METHODS (sizeof methods / sizeof *methods)

static void open_setup(pm_setup *setup, const char *method) {
    char text[4096];
    pm_scene *scene = NULL;
    *setup = (pm_setup){0};
    snprintf(text, sizeof text, scene_text, method);
    if (pm_scene_parse(&scene, text, "row.yaml") != PM_OK ||
        pm_setup_open(setup, scene, NULL) != PM_OK ||
        pm_setup_complete(setup, PM_TO_SERVE) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_int_equal(scene->physics.nz, NZ);
    setup->boundary_input.held = NULL;
}

// Gives every copy a state and inputs of its own, which follow from its number.
static void scatter(pm_fleet *fleet) {
    const int ninput = fleet->setup->scene->physics.nprescribed;
    for (int64_t i = 0; i < fleet->count; ++i) {
        pm_rng rng;
        pm_rng_init(&rng, 7, (uint64_t)i);
        for (int k = 0; k < NZ; ++k) {
            fleet->z[i * NZ + k] += 0.1 * pm_rng_normal(&rng);
        }
        for (int k = 0; k < ninput; ++k) {
            fleet->input[i * ninput + k] = k % 3 == i % 3 ? 0.1 * pm_rng_normal(&rng) : NAN;
        }
    }
}

static void open_fleet(pm_fleet *fleet, const pm_setup *setup, int64_t count, int threads) {
    if (pm_fleet_open(fleet, setup, count, threads) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    scatter(fleet);
}

// Runs copy number `copy` alone for `steps` steps from its scattered start, and compares.
static void assert_alone(const pm_setup *setup, const pm_fleet *fleet, int64_t copy, long steps,
                         const char *what) {
    pm_setup own = *setup;
    pm_fleet start;
    pm_local_run run;
    open_fleet(&start, setup, copy + 1, 1);
    own.boundary_input.held = start.input + copy * setup->scene->physics.nprescribed;
    assert_int_equal(pm_local_run_open(&run, &own, PM_LOCAL_UNDO), PM_OK);
    assert_int_equal(pm_local_run_start(&run, start.z + copy * NZ), PM_OK);
    for (long k = 0; k < steps; ++k) {
        assert_int_equal(pm_local_run_step(&run), PM_OK);
    }
    if (memcmp(run.sample.z, fleet->z + copy * NZ, NZ * sizeof(double)) != 0 ||
        memcmp(run.sample.energy, fleet->energy + copy * BODIES, BODIES * sizeof(double)) != 0 ||
        memcmp(run.sample.entropy, fleet->entropy + copy * BODIES, BODIES * sizeof(double)) != 0 ||
        fleet->step[copy] != steps) {
        fail_msg("%s: copy %d of %d has other bits than alone", what, (int)copy, (int)fleet->count);
    }
    pm_local_run_close(&run);
    pm_fleet_close(&start);
}

static void copies_have_the_bits_of_one_alone(void **state) {
    (void)state;
    const int64_t counts[] = {1, 2, 7, 9, 65, 150};
    for (size_t m = 0; m < METHODS; ++m) {
        pm_setup setup;
        open_setup(&setup, methods[m]);
        for (size_t i = 0; i < sizeof counts / sizeof *counts; ++i) {
            for (int threads = 1; threads <= 3; threads += 2) {
                pm_fleet fleet;
                open_fleet(&fleet, &setup, counts[i], threads);
                pm_fleet_step(&fleet, 3);
                pm_fleet_step(&fleet, 0);
                pm_fleet_step(&fleet, 4);
                assert_string_equal(fleet.why, "");
                assert_alone(&setup, &fleet, 0, 7, methods[m]);
                assert_alone(&setup, &fleet, counts[i] / 2, 7, methods[m]);
                assert_alone(&setup, &fleet, counts[i] - 1, 7, methods[m]);
                pm_fleet_close(&fleet);
            }
        }
        pm_setup_free(&setup);
    }
}

// A copy that fails ends in the state before its step, and no other copy notices.
static void copies_end_and_rest_alone(void **state) {
    (void)state;
    for (size_t m = 0; m < METHODS; ++m) {
        pm_setup setup;
        pm_fleet fleet;
        open_setup(&setup, methods[m]);
        const int ninput = setup.scene->physics.nprescribed;
        open_fleet(&fleet, &setup, 70, 2);
        pm_fleet_step(&fleet, 2);
        fleet.ended[5] = -1;
        fleet.z[12 * NZ] = NAN;
        const double kept = fleet.input[66 * ninput + 2];
        fleet.input[66 * ninput + 2] = 1e300;
        pm_fleet_step(&fleet, 3);
        assert_int_equal(fleet.ended[12], PM_ENUMERIC);
        assert_int_equal(fleet.ended[66], PM_ENUMERIC);
        assert_memory_equal(fleet.why, "copy 12: step 3: ", 17);
        assert_alone(&setup, &fleet, 5, 2, methods[m]);
        assert_alone(&setup, &fleet, 66, 2, methods[m]);
        assert_alone(&setup, &fleet, 11, 5, methods[m]);
        assert_alone(&setup, &fleet, 69, 5, methods[m]);
        fleet.input[66 * ninput + 2] = kept;
        fleet.ended[5] = fleet.ended[66] = 0;
        pm_fleet_step(&fleet, 2);
        assert_string_equal(fleet.why, "");
        assert_alone(&setup, &fleet, 5, 4, methods[m]);
        assert_alone(&setup, &fleet, 66, 4, methods[m]);
        assert_alone(&setup, &fleet, 69, 7, methods[m]);
        pm_fleet_close(&fleet);
        pm_setup_free(&setup);
    }
}

static void saved_copies_go_on(void **state) {
    (void)state;
    for (size_t m = 0; m < METHODS; ++m) {
        pm_setup setup;
        pm_fleet fleet;
        open_setup(&setup, methods[m]);
        open_fleet(&fleet, &setup, 20, 2);
        pm_fleet_step(&fleet, 2);
        const int64_t chosen[] = {3, 19}, other[] = {3, 20};
        double *rows = calloc(2 * (size_t)fleet.row, sizeof *rows);
        assert_non_null(rows);
        assert_int_equal(pm_fleet_copy(&fleet, false, 2, other, rows), PM_EUSAGE);
        assert_int_equal(pm_fleet_copy(&fleet, false, 2, chosen, rows), PM_OK);
        pm_fleet_step(&fleet, 5);
        memset(fleet.z + 3 * NZ, 0, NZ * sizeof *fleet.z);
        assert_int_equal(pm_fleet_copy(&fleet, true, 2, chosen, rows), PM_OK);
        pm_fleet_step(&fleet, 2);
        assert_alone(&setup, &fleet, 3, 4, methods[m]);
        assert_alone(&setup, &fleet, 19, 4, methods[m]);
        assert_alone(&setup, &fleet, 18, 9, methods[m]);
        free(rows);
        pm_fleet_close(&fleet);
        pm_setup_free(&setup);
    }
}

static void wrong_numbers_are_refused(void **state) {
    (void)state;
    pm_setup setup;
    open_setup(&setup, methods[0]);
    const struct {
        int64_t count;
        int threads;
    } wrong[] = {{0, 1}, {-1, 1}, {INT64_MAX, 1}, {1, -1}, {1, 100000}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; ++i) {
        pm_fleet fleet;
        assert_int_equal(pm_fleet_open(&fleet, &setup, wrong[i].count, wrong[i].threads),
                         PM_EUSAGE);
        pm_fleet_close(&fleet);
    }
    pm_setup_free(&setup);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(copies_have_the_bits_of_one_alone),
        cmocka_unit_test(copies_end_and_rest_alone),
        cmocka_unit_test(saved_copies_go_on),
        cmocka_unit_test(wrong_numbers_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
