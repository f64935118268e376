// Adam with decay: what it takes from each weight, apart from the step along the gradient.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "optimise/optimiser.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(decay_shrinks_weights_apart_from_the_gradient),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
