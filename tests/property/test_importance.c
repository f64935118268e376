// Batches in which samples with large residuals are more likely: the probabilities, and that the
// expected gradient stays that of all samples. The penalty on large weights and its gradient.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "optimise/importance.h"
#include "optimise/normal_equations.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define COUNT 60
#define WANTED 20
#define DRAWS 2000
#define NZ 10
// The relative error of sums in another order.
#define SAME 1e-11

// Shares of which a few dominate, and some are zero.
static void draw_shares(uint64_t seed, double *share) {
    pm_rng rng;
    pm_rng_init(&rng, seed, 0);
    for (int i = 0; i < COUNT; ++i) {
        share[i] = i % 7 == 3 ? 0 : exp(3 * pm_rng_normal(&rng));
    }
}

static void chances_have_the_sum_of_the_batch(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 20; ++seed) {
        double share[COUNT], chance[COUNT];
        draw_shares(seed, share);
        memcpy(chance, share, sizeof chance);
        pm_importance_chances(COUNT, chance, WANTED);
        double sum = 0;
        for (int i = 0; i < COUNT; ++i) {
            assert_true(chance[i] >= 0.5 * WANTED / COUNT && chance[i] <= 1);
            sum += chance[i];
            for (int j = 0; j < COUNT; ++j) {
                assert_true(share[i] >= share[j] || chance[i] <= chance[j]);
            }
        }
        assert_true(fabs(sum - WANTED) < 1e-9);
    }
}

static void equal_or_no_shares_make_a_uniform_batch(void **state) {
    (void)state;
    for (int k = 0; k < 2; ++k) {
        double chance[COUNT];
        for (int i = 0; i < COUNT; ++i) {
            chance[i] = k;
        }
        pm_importance_chances(COUNT, chance, WANTED);
        for (int i = 0; i < COUNT; ++i) {
            assert_true(fabs(chance[i] - (double)WANTED / COUNT) < 1e-12);
        }
    }
}

static void samples_are_chosen_as_often_as_their_chances_say(void **state) {
    (void)state;
    double chance[COUNT], often[COUNT] = {0};
    draw_shares(1, chance);
    pm_importance_chances(COUNT, chance, WANTED);
    for (int k = 0; k < DRAWS; ++k) {
        int chosen[WANTED + 1];
        const int n = pm_importance_choose(COUNT, chance, WANTED, (k + 0.5) / DRAWS, chosen);
        assert_true(abs(n - WANTED) <= 1);
        for (int i = 0; i < n; ++i) {
            assert_true(i == 0 || chosen[i] > chosen[i - 1]);
            often[chosen[i]] += 1.0 / DRAWS;
        }
    }
    for (int i = 0; i < COUNT; ++i) {
        assert_true(fabs(often[i] - chance[i]) <= 1.0 / DRAWS + 1e-9);
    }
}

// The loss of a random system on random windows of one step.
typedef struct bench {
    random_system w;
    double z[COUNT * 2 * NZ], scale[NZ];
    pm_samples samples;
    pm_loss loss;
    pm_objective *objective;
    int size, index[COUNT];
} bench;

static void bench_open(bench *b) {
    random_system_of_text(&b->w, 3, random_system_scene, random_system_part, random_system_port);
    for (int i = 0; i < COUNT * 2 * NZ; ++i) {
        b->z[i] = i % (2 * NZ) < NZ ? 0.5 * pm_rng_normal(&b->w.rng)
                                    : b->z[i - NZ] + 0.005 * pm_rng_normal(&b->w.rng);
    }
    for (int i = 0; i < NZ; ++i) {
        b->scale[i] = 0.01;
    }
    for (int i = 0; i < COUNT; ++i) {
        b->index[i] = i;
    }
    b->samples = (pm_samples){.count = COUNT, .unroll = 1, .nz = NZ, .z = b->z, .scale = b->scale};
    b->loss = (pm_loss){.residual = PM_RESIDUAL_STEP,
                        .integrator = pm_integrator_find("euler"),
                        .substeps = 1,
                        .robust = 2};
    assert_int_equal(pm_objective_open(&b->objective, b->w.system, &b->samples, &b->loss), PM_OK);
    pm_objective_evaluate(b->objective, COUNT, b->index, NULL);
    assert_int_equal(pm_objective_rescale(b->objective, 0, NULL), PM_OK);
    pm_objective_evaluate(b->objective, COUNT, b->index, NULL);
    b->size = pm_objective_size(b->objective);
}

// Compares the gradient on weighted samples with the weighted mean of those of single samples.
static void weighted_samples_count_by_their_importance(void **state) {
    (void)state;
    bench b;
    bench_open(&b);
    const size_t n = (size_t)b.size;
    double *work = calloc(n * (n + 4), sizeof *work), importance[COUNT];
    assert_non_null(work);
    double *one = work, *mean = one + n, *gradient = mean + n, *diagonal = gradient + n,
           *matrix = diagonal + n;
    pm_gauss_newton *m = NULL;
    pm_gauss_newton *p = NULL;
    assert_int_equal(pm_gauss_newton_open(&m, b.objective, true, NULL), PM_OK);
    assert_int_equal(pm_gauss_newton_open(&p, b.objective, false, NULL), PM_OK);
    for (int i = 0; i < COUNT; ++i) {
        importance[i] = 0.5 + i % 5;
        pm_gauss_newton_evaluate(m, 1, &i, one, matrix);
        for (size_t k = 0; k < n; ++k) {
            mean[k] += importance[i] * one[k] / COUNT;
        }
        assert_true(pm_objective_sample_share(b.objective, i) > 0);
    }
    pm_objective_set_importance(b.objective, importance);
    pm_gauss_newton_evaluate(m, COUNT, b.index, gradient, matrix);
    pm_gauss_newton_linearise(p, COUNT, b.index, 1, one, diagonal);
    double size = 0;
    for (size_t k = 0; k < n; ++k) {
        size = fmax(size, fabs(mean[k]));
    }
    for (size_t k = 0; k < n; ++k) {
        random_system_check(&b.w, "gradient by the matrix", gradient[k], mean[k], SAME * size);
        random_system_check(&b.w, "gradient by products", one[k], mean[k], SAME * size);
    }
    pm_gauss_newton_close(m);
    pm_gauss_newton_close(p);
    pm_objective_close(b.objective);
    random_system_close(&b.w);
    free(work);
}

// The gradient of the equations contains that of the penalty on weights of hidden layers.
static void the_penalty_is_differentiated(void **state) {
    (void)state;
    bench b;
    bench_open(&b);
    pm_damped_equations e;
    double *theta = calloc(2 * (size_t)b.size, sizeof *theta), *plain = theta + b.size;
    assert_non_null(theta);
    assert_int_equal(pm_damped_equations_open(&e, b.objective, 0, true, NULL), PM_OK);
    pm_objective_weights(b.objective, theta);
    pm_damped_equations_linearise(&e, COUNT, b.index, 1, 1, theta);
    memcpy(plain, e.gradient, (size_t)b.size * sizeof *plain);
    e.shrinkage = 0.1;
    pm_damped_equations_linearise(&e, COUNT, b.index, 1, 1, theta);
    int shrinking = 0;
    for (int i = 0; i < b.size; ++i) {
        const double kept = theta[i], h = 1e-3;
        theta[i] = kept + h;
        const double above = pm_damped_equations_penalty(&e, theta);
        theta[i] = kept - h;
        const double slope = (above - pm_damped_equations_penalty(&e, theta)) / (2 * h);
        theta[i] = kept;
        shrinking += slope != 0;
        random_system_check(&b.w, "gradient of the penalty", e.gradient[i] - plain[i], slope,
                            1e-5 * (1 + fabs(slope)) + 1e-12 * fabs(plain[i]));
    }
    assert_true(shrinking > 0 && shrinking < b.size);
    pm_damped_equations_close(&e);
    free(theta);
    pm_objective_close(b.objective);
    random_system_close(&b.w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(chances_have_the_sum_of_the_batch),
        cmocka_unit_test(equal_or_no_shares_make_a_uniform_batch),
        cmocka_unit_test(samples_are_chosen_as_often_as_their_chances_say),
        cmocka_unit_test(weighted_samples_count_by_their_importance),
        cmocka_unit_test(the_penalty_is_differentiated),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
