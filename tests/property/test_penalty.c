// The penalty on weights of hidden layers in a guarded run of Gauss-Newton: where such a run ends,
// the gradient of the loss is the opposite of that of the penalty, for samples of single steps. For
// windows of several steps there is no penalty, and the gradient of the loss is zero.
#include <math.h>
#include <stdlib.h>

#include "optimise/optimiser.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define COUNT 60
#define MOST_STEPS 3
#define NZ 10
#define RUNS 2 // one after the other, as a run ends when it gains little

// A random system and windows that no model can follow, so that the loss does not vanish.
typedef struct bench {
    random_system w;
    double z[COUNT * (1 + MOST_STEPS) * NZ], scale[NZ];
    pm_samples samples;
    pm_loss loss;
    pm_objective *objective;
    size_t size;
} bench;

static void bench_open(bench *b, uint64_t seed, int steps) {
    random_system_of_text(&b->w, seed, random_system_scene, random_system_part, random_system_port);
    b->w.scene->physics.dt = 0.002; // short enough for random models
    const int width = (1 + steps) * NZ;
    for (int i = 0; i < COUNT * width; ++i) {
        b->z[i] = i % width < NZ ? 0.5 * pm_rng_normal(&b->w.rng)
                                 : b->z[i - NZ] + 0.005 * pm_rng_normal(&b->w.rng);
    }
    for (int i = 0; i < NZ; ++i) {
        b->scale[i] = 0.01;
    }
    b->samples =
        (pm_samples){.count = COUNT, .unroll = steps, .nz = NZ, .z = b->z, .scale = b->scale};
    b->loss = (pm_loss){
        .residual = PM_RESIDUAL_STEP, .integrator = pm_integrator_find("euler"), .substeps = 1};
    assert_int_equal(pm_objective_open(&b->objective, b->w.system, &b->samples, &b->loss), PM_OK);
    b->size = (size_t)pm_objective_size(b->objective);
}

static void bench_close(bench *b) {
    pm_objective_close(b->objective);
    random_system_close(&b->w);
}

static pm_status go_on(void *context, const pm_optimisation *o, double loss) {
    (void)context, (void)o, (void)loss;
    return PM_OK;
}

// Marks the trained weights of hidden layers.
static void mark_hidden(const bench *b, bool *hidden) {
    for (int i = 0; i < pm_system_components(b->w.system); ++i) {
        const pm_params *params = pm_system_params(b->w.system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            for (int c = 0; entry->trained && c < entry->rows * entry->cols; ++c) {
                *hidden++ = entry->shrinks;
            }
        }
    }
}

// Returns the factor f for which the gradient of the loss, at the end of a guarded run, is closest
// to -f times the loss times the cubes of the weights of hidden layers.
static double penalty_at_end(uint64_t seed, int steps) {
    bench b;
    bench_open(&b, seed, steps);
    double *theta = calloc(4 * b.size, sizeof *theta), *gradient = theta + b.size;
    bool *hidden = calloc(b.size, sizeof *hidden);
    assert_true(theta != NULL && hidden != NULL);
    pm_objective_weights(b.objective, theta);
    for (int i = 0; i < RUNS; ++i) {
        pm_optimisation o = {.objective = b.objective,
                             .schedule = {.iterations = 100, .batch = COUNT, .guarded = true},
                             .seed = 1,
                             .theta = theta,
                             .moment = theta + 2 * b.size,
                             .report = go_on};
        assert_int_equal(pm_optimiser_find("gauss_newton")->run(&o), PM_OK);
    }
    const double loss = pm_objective_evaluate(b.objective, 0, NULL, gradient);
    double along = 0, square = 0;
    mark_hidden(&b, hidden);
    for (size_t i = 0; i < b.size; ++i) {
        const double cube = hidden[i] ? pow(theta[i], 3) : 0;
        along -= gradient[i] * cube;
        square += cube * cube;
    }
    assert_true(loss > 0 && square > 0);
    free(theta);
    free(hidden);
    bench_close(&b);
    return along / (loss * square);
}

// The equations have half the gradient of the loss, so that the factor is 2e-2 for a penalty of
// 1e-2/4 times the loss times the sum of the fourth powers.
static void single_steps_have_a_penalty(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 2; ++seed) {
        const double factor = penalty_at_end(seed, 1);
        if (!(factor > 1e-2 && factor < 4e-2)) {
            fail_msg("seed %d: a penalty with the factor %g, expected 0.02", (int)seed, factor);
        }
    }
}

static void windows_of_several_steps_have_none(void **state) {
    (void)state;
    for (int steps = 2; steps <= MOST_STEPS; ++steps) {
        const double factor = penalty_at_end(1, steps);
        if (!(fabs(factor) < 1e-4)) {
            fail_msg("%d steps: a penalty with the factor %g, expected none", steps, factor);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(single_steps_have_a_penalty),
        cmocka_unit_test(windows_of_several_steps_have_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
