// Copies of a scene (library/fleet.h) have the bits of runs alone: for any number of copies and
// threads, for every kind of integrator, with inputs of their own, after copies that failed,
// rested, or were saved and restored. Derivatives of their rollouts (library/fleet_gradient.h)
// agree with differences and with each other, and do not depend on other copies.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "library/fleet_gradient.h"
#include "library/local_run.h"
#include "tests/support/row_of_bodies.h"
#include "tests/support/unit.h"

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

static double *some(int64_t n, uint64_t stream) {
    double *x = calloc((size_t)n + 1, sizeof *x);
    pm_rng rng;
    assert_non_null(x);
    pm_rng_init(&rng, 11, stream);
    for (int64_t i = 0; i < n && stream > 0; ++i) {
        x[i] = 0.1 * pm_rng_normal(&rng);
    }
    return x;
}

static void open_shipped(pm_setup *setup, const char *name) {
    pm_scene *scene = NULL;
    char path[200];
    snprintf(path, sizeof path, "configs/%s.yaml", name);
    *setup = (pm_setup){0};
    if (pm_scene_load(&scene, path) != PM_OK || pm_setup_open(setup, scene, NULL) != PM_OK ||
        pm_setup_complete(setup, PM_TO_SERVE) != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

// Inputs follow a table, energies are learned, bodies touch: each copy at a time of its own.
static void copies_of_shipped_scenes_have_the_bits_of_the_engine(void **state) {
    (void)state;
    static const char *const names[] = {"driven_lower", "gas_containers", "bouncing_masses",
                                        "chain_3", "double_pendulum"};
    for (size_t i = 0; i < sizeof names / sizeof *names; ++i) {
        pm_setup setup;
        pm_fleet fleet;
        pm_monolithic *alone;
        open_shipped(&setup, names[i]);
        const int nz = setup.scene->physics.nz;
        assert_int_equal(pm_fleet_open(&fleet, &setup, 11, 2), PM_OK);
        double *start = some(11 * nz, 7);
        for (int64_t k = 0; k < 11 * nz; ++k) {
            start[k] = fleet.z[k] *= 1 + 0.01 * start[k];
        }
        for (int k = 0; k < 11; ++k) {
            fleet.step[k] = 3 * k;
        }
        pm_fleet_step(&fleet, 4);
        assert_string_equal(fleet.why, "");
        assert_int_equal(pm_monolithic_open(&alone, setup.system), PM_OK);
        pm_monolithic_set_boundary_input(alone, &setup.boundary_input);
        for (int k = 0; k < 11; ++k) {
            pm_monolithic_set_state(alone, start + k * nz);
            pm_monolithic_set_step(alone, 3 * k);
            for (int step = 0; step < 4; ++step) {
                assert_int_equal(pm_monolithic_step(alone), PM_OK);
            }
            const pm_sample *sample = pm_monolithic_sample(alone);
            const int n = setup.scene->physics.nsubsystem;
            if (memcmp(sample->z, fleet.z + k * nz, (size_t)nz * sizeof(double)) != 0 ||
                memcmp(sample->energy, fleet.energy + k * n, (size_t)n * sizeof(double)) != 0 ||
                memcmp(sample->entropy, fleet.entropy + k * n, (size_t)n * sizeof(double)) != 0) {
                fail_msg("%s: copy %d has other bits than the engine", names[i], k);
            }
        }
        free(start);
        pm_monolithic_close(alone);
        pm_fleet_close(&fleet);
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

// --- derivatives ---

// A rollout of a fleet with random inputs, seeds and directions, and its derivatives.
typedef struct derived {
    int64_t count;
    int ninput, nweight;
    pm_fleet_rollout rollout;
    double *input, *seed, *d_start, *d_input, *d_weight; // as in fleet_gradient.h
    double *z, *dz, *by_start, *by_input, *by_weight;
} derived;

static void derive(derived *d, pm_fleet *fleet, int64_t pieces, int64_t steps) {
    const pm_setup *setup = fleet->setup;
    const int nz = setup->scene->physics.nz;
    const int64_t n = fleet->count, states = pieces * n * nz;
    d->count = n;
    d->ninput = setup->scene->physics.nprescribed;
    d->nweight = pm_fleet_weights(setup->system);
    const int64_t inputs = pieces * n * d->ninput;
    d->input = some(inputs, 1);
    d->seed = some(states, 2);
    d->d_start = some(n * nz, 3);
    d->d_input = some(inputs, 4);
    d->d_weight = some(n * d->nweight, 5);
    d->z = some(states, 0);
    d->dz = some(states, 0);
    d->by_start = some(n * nz, 0);
    d->by_input = some(inputs, 0);
    d->by_weight = some(n * d->nweight, 0);
    d->rollout = (pm_fleet_rollout){pieces, steps, NULL, d->input};
    const pm_status status[] = {
        pm_fleet_jvp(fleet, &d->rollout, d->d_start, d->d_input, d->d_weight, d->z, d->dz),
        pm_fleet_vjp(fleet, &d->rollout, d->seed, d->by_start, d->by_input, d->by_weight)};
    if (status[0] != PM_OK || status[1] != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

static void forget(derived *d) {
    double *all[] = {d->input, d->seed, d->d_start,  d->d_input,  d->d_weight,
                     d->z,     d->dz,   d->by_start, d->by_input, d->by_weight};
    for (size_t i = 0; i < sizeof all / sizeof *all; ++i) {
        free(all[i]);
    }
}

static double product(int64_t n, const double *a, const double *b) {
    double sum = 0;
    for (int64_t i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
}

// The product of a seed with the tangent is that of its gradient with the direction.
static void assert_adjoint(const derived *d, int nz, const char *what) {
    const int64_t pieces = d->rollout.pieces;
    const double forward = product(pieces * d->count * nz, d->seed, d->dz);
    const double reverse = product(d->count * nz, d->by_start, d->d_start) +
                           product(pieces * d->count * d->ninput, d->by_input, d->d_input) +
                           product(d->count * d->nweight, d->by_weight, d->d_weight);
    if (!(fabs(forward - reverse) <= 1e-10 * fabs(forward)) || forward == 0) {
        fail_msg("%s: forward %.15g, reverse %.15g", what, forward, reverse);
    }
}

// Steps a fleet through the rollout from starts and inputs moved by `by` along the directions.
static void roll(pm_fleet *fleet, const derived *d, double by, double *z) {
    const int nz = fleet->setup->scene->physics.nz;
    const int64_t states = d->count * nz, inputs = d->count * d->ninput;
    for (int64_t i = 0; i < states; ++i) {
        fleet->z[i] += by * d->d_start[i];
    }
    for (int64_t p = 0; p < d->rollout.pieces; ++p) {
        for (int64_t i = 0; i < inputs; ++i) {
            fleet->input[i] = d->input[p * inputs + i] + by * d->d_input[p * inputs + i];
        }
        pm_fleet_step(fleet, d->rollout.steps);
        assert_string_equal(fleet->why, "");
        memcpy(z + p * states, fleet->z, (size_t)states * sizeof *z);
    }
}

static void assert_differences(int64_t n, const double *dz, const double *plus, const double *minus,
                               double by, const char *what) {
    for (int64_t i = 0; i < n; ++i) {
        const double difference = (plus[i] - minus[i]) / (2 * by);
        if (!(fabs(dz[i] - difference) <= 1e-7 * (1 + fabs(difference)))) {
            fail_msg("%s: number %d: %.12g, by differences %.12g", what, (int)i, dz[i], difference);
        }
    }
}

static void derivatives_are_those_of_the_steps(void **state) {
    (void)state;
    static const char *const explicit_methods[] = {
        "integrator: rk4, substeps: 2", "integrator: euler", "integrator: heun, substeps: 3"};
    const double by = 1e-4;
    for (size_t m = 0; m < sizeof explicit_methods / sizeof *explicit_methods; ++m) {
        pm_setup setup;
        pm_fleet fleet, moved;
        derived one, many;
        const char *what = explicit_methods[m];
        open_setup(&setup, what);
        open_fleet(&fleet, &setup, 40, 3);
        derive(&many, &fleet, 3, 2);
        assert_adjoint(&many, NZ, what);
        const int64_t n = 3 * 40 * NZ;
        double *z[] = {some(n, 0), some(n, 0), some(n, 0)};
        for (int k = -1; k <= 1; ++k) {
            open_fleet(&moved, &setup, 40, 1);
            roll(&moved, &many, k * by, z[k + 1]);
            pm_fleet_close(&moved);
        }
        assert_memory_equal(many.z, z[1], (size_t)n * sizeof **z);
        assert_differences(n, many.dz, z[2], z[0], by, what);
        // The first copy has the same derivatives alone. Its inputs are the first ones of a piece.
        open_fleet(&moved, &setup, 1, 1);
        derive(&one, &moved, 1, 2);
        pm_fleet_close(&moved);
        open_fleet(&moved, &setup, 40, 2);
        derived again;
        derive(&again, &moved, 1, 2);
        assert_memory_equal(one.by_start, again.by_start, NZ * sizeof(double));
        assert_memory_equal(one.dz, again.dz, NZ * sizeof(double));
        for (int i = 0; i < 3; ++i) {
            free(z[i]);
        }
        forget(&one);
        forget(&many);
        forget(&again);
        pm_fleet_close(&moved);
        pm_fleet_close(&fleet);
        pm_setup_free(&setup);
    }
}

// So many substeps are not kept all at once.
static void long_rollouts_are_taken_in_segments(void **state) {
    (void)state;
    pm_setup setup;
    pm_fleet fleet;
    derived d;
    open_setup(&setup, "integrator: rk4, substeps: 2");
    open_fleet(&fleet, &setup, 33, 2);
    derive(&d, &fleet, 5, 30);
    assert_adjoint(&d, NZ, "segments");
    forget(&d);
    pm_fleet_close(&fleet);
    pm_setup_free(&setup);
}

// Weights are those of the first component here; all numbers change along the direction of copy 0.
static void weights_have_derivatives(void **state) {
    (void)state;
    pm_setup setup;
    pm_fleet fleet;
    derived d;
    const double by = 1e-5;
    open_shipped(&setup, "driven_lower");
    const int nz = setup.scene->physics.nz;
    assert_int_equal(pm_fleet_open(&fleet, &setup, 2, 1), PM_OK);
    derive(&d, &fleet, 2, 3);
    assert_adjoint(&d, nz, "weights");
    assert_true(d.nweight > 0);
    pm_fleet_close(&fleet);
    double *z[2];
    for (int k = 0; k < 2; ++k) {
        int first = 0;
        for (int c = 0; c < pm_system_components(setup.system); ++c) {
            pm_params *params = pm_system_params(setup.system, c);
            for (int i = 0; i < params->count; ++i) {
                const pm_param_entry *e = &params->entry[i];
                for (int j = 0; j < e->rows * e->cols && e->trained; ++j) {
                    e->value[j] += (k == 0 ? by : -2 * by) * d.d_weight[first++];
                }
            }
        }
        assert_int_equal(first, d.nweight);
        z[k] = some(2 * 2 * nz, 0);
        assert_int_equal(pm_fleet_open(&fleet, &setup, 2, 1), PM_OK);
        roll(&fleet, &d, k == 0 ? by : -by, z[k]);
        pm_fleet_close(&fleet);
    }
    for (int p = 0; p < 2; ++p) { // copy 0
        const int at = p * 2 * nz;
        assert_differences(nz, d.dz + at, z[0] + at, z[1] + at, by, "weights");
    }
    free(z[0]);
    free(z[1]);
    forget(&d);
    pm_setup_free(&setup);
}

static void wrong_rollouts_are_refused(void **state) {
    (void)state;
    for (size_t m = 0; m < METHODS; ++m) {
        pm_setup setup;
        pm_fleet fleet;
        double z[NZ] = {0};
        open_setup(&setup, methods[m]);
        open_fleet(&fleet, &setup, 1, 1);
        const pm_fleet_rollout good = {1, 1, NULL, NULL}, empty = {1, 0, NULL, NULL};
        const pm_fleet_rollout long_one = {INT64_MAX / 2, 4, NULL, NULL};
        assert_int_equal(pm_fleet_vjp(&fleet, &good, z, z, NULL, NULL), m < 2 ? PM_OK : PM_ECONFIG);
        assert_int_equal(pm_fleet_vjp(&fleet, &empty, z, z, NULL, NULL), PM_EUSAGE);
        assert_int_equal(pm_fleet_vjp(&fleet, &long_one, z, z, NULL, NULL), PM_EUSAGE);
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
        cmocka_unit_test(copies_of_shipped_scenes_have_the_bits_of_the_engine),
        cmocka_unit_test(copies_end_and_rest_alone),
        cmocka_unit_test(saved_copies_go_on),
        cmocka_unit_test(wrong_numbers_are_refused),
        cmocka_unit_test(derivatives_are_those_of_the_steps),
        cmocka_unit_test(long_rollouts_are_taken_in_segments),
        cmocka_unit_test(weights_have_derivatives),
        cmocka_unit_test(wrong_rollouts_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
