// Bodies of learned material (model/solid/): with random weights, forces are the slope of the
// stored energy, rotations change nothing, and both laws hold in steps of any length.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "tests/support/solid_bar.h"
#include "tests/support/unit.h"

static void forces_are_the_slope_of_the_stored_energy(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 5; ++seed) {
        bar b;
        double u[3 * NODES] = {0}, force[3 * NODES];
        open_bar(&b, 2, seed, 0.5);
        shake(&b, 0.05, u);
        assert_true(pm_solid_follow(b.solid, 0.7, u, NULL)); // the branches relax halfway
        shake(&b, 0.05, u);
        assert_true(pm_solid_follow(b.solid, 0, u, force)); // and now they do not
        for (int i = 0; i < 3 * NODES; ++i) {
            const double h = 1e-5, kept = u[i];
            double energy[2];
            for (int k = 0; k < 2; ++k) {
                u[i] = kept + (k == 0 ? -h : h);
                assert_true(pm_solid_follow(b.solid, 0, u, NULL));
                energy[k] = pm_solid_books_of(b.solid)->stored;
            }
            u[i] = kept;
            assert_near("found", (energy[1] - energy[0]) / (2 * h), force[i],
                        1e-5 * (1 + fabs(force[i])));
        }
        close_bar(&b);
    }
}

static void rotations_of_the_body_change_nothing(void **state) {
    (void)state;
    bar b;
    double u[3 * NODES] = {0}, turned[3 * NODES], force[3 * NODES], also[3 * NODES];
    const double c = cos(0.8), s = sin(0.8);
    open_bar(&b, 2, 7, 0.5);
    shake(&b, 0.1, u);
    assert_true(pm_solid_follow(b.solid, 0.3, u, force));
    const double stored = pm_solid_books_of(b.solid)->stored,
                 heat = pm_solid_books_of(b.solid)->heat;
    for (int i = 0; i < NODES; ++i) {
        const double *x = b.position[i], q[3] = {x[0] + u[3 * i], x[1] + u[3 * i + 1]};
        turned[3 * i] = c * q[0] - s * q[1] - x[0];
        turned[3 * i + 1] = s * q[0] + c * q[1] - x[1];
        turned[3 * i + 2] = u[3 * i + 2];
    }
    assert_true(pm_solid_set_state(b.solid, NULL, NULL));
    assert_true(pm_solid_follow(b.solid, 0.3, turned, also));
    assert_near("found", pm_solid_books_of(b.solid)->stored, stored, 1e-10 * stored);
    assert_near("found", pm_solid_books_of(b.solid)->heat, heat, 1e-10 * stored);
    for (int i = 0; i < NODES; ++i) {
        assert_near("found", also[3 * i], c * force[3 * i] - s * force[3 * i + 1], 1e-8);
        assert_near("found", also[3 * i + 1], s * force[3 * i] + c * force[3 * i + 1], 1e-8);
    }
    close_bar(&b);
}

// Weights far from any real material, and steps from far below to far above all relaxation times.
static void both_laws_hold_for_all_weights_and_steps(void **state) {
    (void)state;
    double total = 0;
    for (uint64_t seed = 1; seed <= 60; ++seed) {
        bar b;
        double u[3 * NODES] = {0}, heat = 0, work = 0, size = 0;
        open_bar(&b, 2, seed, seed % 2 == 0 ? 0.3 : 1.5);
        for (int step = 0; step < 30; ++step) {
            double next[3 * NODES];
            memcpy(next, u, sizeof next);
            shake(&b, 0.05, next);
            if (pm_solid_follow(b.solid, pow(10, pm_rng_normal(&b.rng)), next, NULL)) {
                const pm_solid_books *books = pm_solid_books_of(b.solid);
                memcpy(u, next, sizeof u);
                assert_true(books->heat >= 0);
                heat += books->heat;
                work += books->work;
                size = fmax(size, fmax(fabs(books->stored), fabs(books->work)));
            }
        }
        const double stored = pm_solid_books_of(b.solid)->stored;
        assert_true(size > 0);
        assert_near("found", stored + heat - work, 0, 1e-10 * (size + heat));
        total += heat;
        close_bar(&b);
    }
    assert_true(total > 0);
}

static void a_step_balances_the_forces(void **state) {
    (void)state;
    bar b;
    double f[3 * NODES] = {0}, force[3 * NODES], largest = 0;
    open_bar(&b, 2, 3, 0.1);
    shake(&b, 40, f);
    assert_int_equal(pm_solid_step(b.solid, 0.2, f), PM_OK);
    const double stored = pm_solid_books_of(b.solid)->stored;
    assert_near("found", stored + pm_solid_books_of(b.solid)->heat,
                pm_solid_books_of(b.solid)->work, 1e-11 * stored);
    double u[3 * NODES];
    memcpy(u, pm_solid_displacement(b.solid), sizeof u);
    assert_true(pm_solid_follow(b.solid, 0, u, force));
    for (int i = 0; i < 3 * NODES; ++i) {
        largest = fmax(largest, b.clamped[i / 3] ? 0 : fabs(force[i] - f[i]));
    }
    assert_true(largest < 1e-3);
    close_bar(&b);
}

// At held displacements a branch relaxes at its learned rate, however many steps it takes.
static void branches_relax_at_their_rates(void **state) {
    (void)state;
    for (int steps = 1; steps <= 16; steps *= 4) {
        bar b;
        double u[3 * NODES] = {0};
        open_bar(&b, 2, 5, 0);
        const double rate[2] = {b.material.branch[0].rate, b.material.branch[1].rate};
        assert_near("found", rate[1] / rate[0], exp(2), 1e-9);
        shake(&b, 1e-3, u);
        assert_true(pm_solid_follow(b.solid, 0, u, NULL));
        for (int k = 0; k < steps; ++k) {
            assert_true(pm_solid_follow(b.solid, 0.8 / steps, u, NULL));
        }
        // What a branch still has to go is what it has gone, times 1/(exp(rate t) - 1).
        const double *inner = pm_solid_inner(b.solid);
        double gone[2 * PM_SYM];
        memcpy(gone, inner, sizeof gone);
        assert_true(pm_solid_follow(b.solid, 1e6, u, NULL));
        for (int i = 0; i < 2 * PM_SYM; ++i) {
            const double share = 1 - exp(-0.8 * rate[i / PM_SYM]);
            assert_near("found", gone[i], share * inner[i], 5e-3 * fabs(inner[i]) + 1e-6);
        }
        close_bar(&b);
    }
}

// A body of no free nodes, and one that is turned inside out, are refused.
static void bodies_that_cannot_be_are_refused(void **state) {
    (void)state;
    bar b;
    pm_solid *other = NULL;
    open_bar(&b, 2, 2, 0);
    memset(b.clamped, true, sizeof b.clamped);
    assert_int_equal(pm_solid_open(&other, &b.mesh, &b.material), PM_ECONFIG);
    memset(b.clamped, false, sizeof b.clamped);
    const int node = b.brick[1][0];
    b.brick[1][0] = b.brick[1][1];
    b.brick[1][1] = node;
    assert_int_equal(pm_solid_open(&other, &b.mesh, &b.material), PM_ECONFIG);
    close_bar(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forces_are_the_slope_of_the_stored_energy),
        cmocka_unit_test(rotations_of_the_body_change_nothing),
        cmocka_unit_test(both_laws_hold_for_all_weights_and_steps),
        cmocka_unit_test(a_step_balances_the_forces),
        cmocka_unit_test(branches_relax_at_their_rates),
        cmocka_unit_test(bodies_that_cannot_be_are_refused),
    };
    pm_linalg_init();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
