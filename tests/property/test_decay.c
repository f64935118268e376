// Weights that decay: what adam takes from each weight, apart from the step along the gradient, and
// the penalty of Gauss-Newton.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "learn/damped_equations.h"
#include "learn/optimiser.h"
#include "tests/support/random_system.h"

#define COUNT 40
#define NZ 10
#define RATE 1e-2
// The relative error of one product and one sum.
#define TOLERANCE 1e-14

// The loss of a random system on random windows of one step.
typedef struct bench {
    random_system w;
    double z[COUNT * 2 * NZ], scale[NZ];
    pm_samples samples;
    pm_loss loss;
    pm_objective *objective;
    size_t size;
} bench;

static void bench_open(bench *b, uint64_t seed) {
    random_system_of_text(&b->w, seed, random_system_scene, random_system_part, random_system_port);
    for (int i = 0; i < COUNT * 2 * NZ; ++i) {
        b->z[i] = i % (2 * NZ) < NZ ? 0.5 * pm_rng_normal(&b->w.rng)
                                    : b->z[i - NZ] + 0.005 * pm_rng_normal(&b->w.rng);
    }
    for (int i = 0; i < NZ; ++i) {
        b->scale[i] = 0.01;
    }
    b->samples = (pm_samples){.count = COUNT, .unroll = 1, .nz = NZ, .z = b->z, .scale = b->scale};
    b->loss = (pm_loss){.residual = PM_RESIDUAL_STEP,
                        .integrator = pm_integrator_find("euler"),
                        .substeps = 1,
                        .degeneracy = 1};
    b->objective = NULL;
    assert_int_equal(pm_objective_open(&b->objective, b->w.system, &b->samples, &b->loss), PM_OK);
    b->size = (size_t)pm_objective_size(b->objective);
}

static void bench_close(bench *b) {
    pm_objective_close(b->objective);
    random_system_close(&b->w);
}

static double *vector(size_t size) {
    double *v = calloc(size, sizeof *v);
    assert_non_null(v);
    return v;
}

static pm_status go_on(void *context, const pm_optimisation *optimisation, double loss) {
    (void)context;
    (void)optimisation;
    (void)loss;
    return PM_OK;
}

// One update with all samples, from the weights `start` to `theta`.
static void update_once(bench *b, double decay, const double *start, double *theta) {
    double *moment = vector(2 * b->size);
    memcpy(theta, start, b->size * sizeof *theta);
    pm_objective_set_weights(b->objective, theta);
    pm_optimisation o = {.objective = b->objective,
                         .schedule = {.iterations = 1,
                                      .batch = COUNT,
                                      .first_rate = RATE,
                                      .last_rate = RATE,
                                      .beta2 = 0.999,
                                      .decay = decay},
                         .seed = 1,
                         .theta = theta,
                         .moment = moment,
                         .report = go_on};
    assert_int_equal(pm_optimiser_find("adam")->run(&o), PM_OK);
    free(moment);
}

static void decay_shrinks_weights_apart_from_the_gradient(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 5; ++seed) {
        const double decay = 3;
        bench b;
        bench_open(&b, seed);
        double *start = vector(b.size), *plain = vector(b.size), *decayed = vector(b.size);
        pm_objective_weights(b.objective, start);
        update_once(&b, 0, start, plain);
        update_once(&b, decay, start, decayed);
        for (size_t i = 0; i < b.size; ++i) {
            const double expected = plain[i] - RATE * decay * start[i];
            if (!(fabs(decayed[i] - expected) <= TOLERANCE * (1 + fabs(start[i])))) {
                random_system_fail(&b.w, "weight %zu: %.17g, expected %.17g, tolerance %g", i,
                                   decayed[i], expected, TOLERANCE);
            }
        }
        free(start);
        free(plain);
        free(decayed);
        bench_close(&b);
    }
}

// Lets every other trained entry of a system decay.
static void mark_decaying(const pm_objective *objective) {
    pm_system *system = pm_objective_context(objective).system;
    int count = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        pm_params *params = pm_system_params(system, i);
        for (int k = 0; k < params->count; ++k) {
            params->entry[k].decays = params->entry[k].trained && count++ % 2 == 0;
        }
    }
}

// Checks that the step takes weights that decay to zero and leaves the others as they are.
static void check_step(bench *b, const pm_damped_equations *e, const double *theta,
                       const double *step) {
    size_t decaying = 0;
    double sum = 0;
    for (size_t i = 0; i < b->size; ++i) {
        const double expected = e->decays[i] > 0 ? -theta[i] : 0;
        random_system_check(&b->w, "step", step[i], expected, 1e-6 * (1 + fabs(theta[i])));
        decaying += e->decays[i] > 0;
        sum += e->decays[i] * theta[i] * theta[i];
    }
    assert_true(decaying > 0 && decaying < b->size);
    const double penalty = pm_damped_equations_penalty(e, theta);
    random_system_check(&b->w, "penalty", penalty, 0.5 * e->decay * sum, 1e-12 * penalty);
}

// A penalty that outweighs the loss takes weights that decay to zero in one step, with a matrix and
// without.
static void a_large_penalty_removes_weights(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 3);
    mark_decaying(b.objective);
    double *theta = vector(b.size), *step = vector(b.size);
    int index[COUNT];
    for (int i = 0; i < COUNT; ++i) {
        index[i] = i;
    }
    pm_objective_weights(b.objective, theta);
    for (int matrix = 0; matrix < 2; ++matrix) {
        pm_damped_equations e;
        memset(step, 0, b.size * sizeof *step);
        pm_objective_set_weights(b.objective, theta);
        const double loss = pm_objective_evaluate(b.objective, COUNT, index, NULL);
        assert_int_equal(pm_damped_equations_open(&e, b.objective, matrix == 1), PM_OK);
        e.near = 1e14 * loss;
        e.decay = 1e10 * e.near;
        pm_damped_equations_linearise(&e, theta, COUNT, index, 1, loss);
        assert_true(pm_damped_equations_solve(&e, theta, 0, 100, step));
        check_step(&b, &e, theta, step);
        pm_damped_equations_close(&e);
    }
    free(theta);
    free(step);
    bench_close(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(decay_shrinks_weights_apart_from_the_gradient),
        cmocka_unit_test(a_large_penalty_removes_weights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
