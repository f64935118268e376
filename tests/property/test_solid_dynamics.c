// Steps of solids in scenes (sim/solid_dynamics.h): with random weights and random forces, energy
// is conserved and the heat is never negative, with and without branches; a restored solid goes on
// with the same bits.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "sim/solid_dynamics.h"
#include "tests/support/solid_bar.h"
#include "tests/support/unit.h"

#define FORCES (3 * NODES)
#define MOST_STATE (2 * FORCES + 2 * ELEMENTS * PM_BRICK_POINTS * PM_SYM + 1)

// A bar and its dynamics. The state consists of u, p, inner where there are branches, and s.
typedef struct body {
    bar bar;
    pm_group group[4];
    pm_part part;
    pm_arena arena;
    pm_solid_dynamics dynamics;
    double z[MOST_STATE], rate[MOST_STATE];
} body;

static void open_body(body *b, int nbranch, uint64_t seed) {
    memset(b, 0, sizeof *b);
    open_bar(&b->bar, nbranch, seed, 0.1);
    const int inner = nbranch * ELEMENTS * PM_BRICK_POINTS * PM_SYM;
    b->part = (pm_part){.layout = {.group = b->group},
                        .spec = {.form = PM_HARD, .solid = &b->bar.spec},
                        .params = b->bar.params};
    pm_layout_add(&b->part.layout, "u", "m", FORCES);
    pm_layout_add(&b->part.layout, "p", "kg m/s", FORCES);
    if (nbranch > 0) {
        pm_layout_add(&b->part.layout, "inner", "1", inner);
    }
    pm_layout_add(&b->part.layout, "s", "J/K", 1);
    assert_int_equal(pm_solid_dynamics_open(&b->dynamics, &b->arena, &b->part, &b->bar.mesh),
                     PM_OK);
    pm_solid_dynamics_start(&b->dynamics, b->z);
}

static void close_body(body *b) {
    pm_solid_dynamics_close(&b->dynamics);
    pm_arena_free(&b->arena);
    close_bar(&b->bar);
}

// Takes a step of h s in which the forces change from `from` to `to`. Returns what of the energy is
// neither in the body nor was the work of the ports, J.
static double step(body *b, double h, const double *from, const double *to) {
    pm_solid_dynamics *d = &b->dynamics;
    double work = 0;
    pm_solid_dynamics_expose(d, b->z, b->z, h);
    const double before = d->E;
    for (int i = 0; i < FORCES; ++i) {
        b->rate[d->p + i] = (from[i] + to[i]) / 2;
        d->end_rate[d->p + i] = to[i];
    }
    if (!pm_solid_dynamics_balance(d, h, b->z, b->rate)) {
        fail_msg("%s", pm_error());
    }
    pm_solid_dynamics_expose(d, d->result, b->z, h);
    for (int i = 0; i < FORCES; ++i) {
        work += h * d->dE[d->p + i] * b->rate[d->p + i];
    }
    const double residual = d->E - before - work;
    memcpy(b->z, d->result, (size_t)b->part.layout.nz * sizeof *b->z);
    pm_solid_dynamics_end_substep(d);
    return residual;
}

static void both_laws_hold_in_every_step(void **state) {
    (void)state;
    for (int nbranch = 0; nbranch <= 2; nbranch += 2) {
        int shortened = 0;
        for (uint64_t seed = 1; seed <= 20; ++seed) {
            body b;
            double from[FORCES] = {0}, to[FORCES];
            open_body(&b, nbranch, seed);
            for (int k = 0; k < 20; ++k) {
                const double s = b.z[b.dynamics.s];
                memset(to, 0, sizeof to);
                shake(&b.bar, 0.2, to);
                const double h = pow(10, pm_rng_normal(&b.bar.rng));
                const double residual = step(&b, h, from, to);
                assert_true(fabs(residual) < 1e-11 * (1 + fabs(b.dynamics.E)));
                assert_true(b.z[b.dynamics.s] >= s);
                shortened += nbranch == 0 && b.z[b.dynamics.s] - s > 0;
                memcpy(from, to, sizeof to);
            }
            close_body(&b);
        }
        assert_true(nbranch > 0 || shortened > 0);
    }
}

// A body without branches stores what the forces do, but for the error of the trapezoidal rule.
static void an_elastic_body_heats_little(void **state) {
    (void)state;
    body b;
    double force[2][FORCES] = {{0}}, final[FORCES] = {0};
    open_body(&b, 0, 4);
    shake(&b.bar, 20, final);
    for (int k = 0; k < 20; ++k) {
        for (int i = 0; i < FORCES; ++i) {
            force[(k + 1) % 2][i] = final[i] * (k + 1) / 20;
        }
        step(&b, 0.1, force[k % 2], force[(k + 1) % 2]);
    }
    const double heat = b.dynamics.temperature * b.dynamics.S;
    assert_true(b.dynamics.E - heat > 0);
    assert_true(heat < 2e-3 * (b.dynamics.E - heat));
    close_body(&b);
}

// The stiffness may belong to an earlier state, which the serializer keeps.
static void a_restored_solid_goes_on_with_the_same_bits(void **state) {
    (void)state;
    body b, other;
    double force[9][FORCES] = {{0}};
    open_body(&b, 2, 6);
    open_body(&other, 2, 6);
    for (int k = 0; k < 8; ++k) {
        memcpy(force[k + 1], force[k], sizeof force[k]);
        shake(&b.bar, 10, force[k + 1]);
    }
    for (int k = 0; k < 5; ++k) {
        step(&b, 0.2, force[k], force[k + 1]);
    }
    pm_serializer count = pm_serializer_count("solid");
    pm_solid_dynamics_record(&b.dynamics, &count);
    double *kept = calloc((size_t)count.count, sizeof *kept);
    assert_non_null(kept);
    pm_serializer save = pm_serializer_save("solid", kept),
                  restore = pm_serializer_restore("solid", kept);
    pm_solid_dynamics_record(&b.dynamics, &save);
    memcpy(other.z, b.z, sizeof b.z);
    pm_solid_dynamics_start(&other.dynamics, other.z);
    pm_solid_dynamics_record(&other.dynamics, &restore);
    for (int k = 5; k < 8; ++k) {
        step(&b, 0.2, force[k], force[k + 1]);
        step(&other, 0.2, force[k], force[k + 1]);
    }
    assert_memory_equal(b.z, other.z, sizeof b.z);
    free(kept);
    close_body(&other);
    close_body(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_laws_hold_in_every_step),
        cmocka_unit_test(an_elastic_body_heats_little),
        cmocka_unit_test(a_restored_solid_goes_on_with_the_same_bits),
    };
    pm_linalg_init();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
