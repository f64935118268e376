// Elementary functions: close to exact values, and the same bits alone and in vectorised loops.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/elementary.h"
#include "base/rng.h"
#include "graph/graph.h"
#include "graph/program.h"
#include "tests/support/unit.h"

#define SAMPLES 200000
#define LONGEST 37 // numbers of an array; every shorter length is tried, too

// Largest relative error, in units of the last place at 1. Two of them are promised.
#define TOLERANCE 2.0

typedef struct function {
    const char *name;
    double (*plain)(double);
    pm_node (*node)(pm_graph *, pm_node); // runs the function in a vectorised loop
    long double (*exact)(long double);
    double low, high;
} function;

static long double exact_sigmoid(long double x) {
    return 1 / (1 + expl(-x));
}

static long double exact_softplus(long double x) {
    return (x > 0 ? x : 0) + log1pl(expl(-fabsl(x)));
}

static const function functions[] = {
    {"tanh", pm_tanh_of, pm_tanh, tanhl, -25, 25},
    {"tanh, small", pm_tanh_of, pm_tanh, tanhl, -1e-3, 1e-3},
    {"exp", pm_exp_of, pm_exp, expl, -700, 700},
    {"exp, small", pm_exp_of, pm_exp, expl, -1, 1},
    {"sigmoid", pm_sigmoid_of, pm_sigmoid, exact_sigmoid, -40, 40},
    {"softplus", pm_softplus_of, pm_softplus, exact_softplus, -40, 40},
    {"log", pm_log_of, pm_log, logl, 0, 1e3},
    {"log, near 1", pm_log_of, pm_log, logl, 0.6, 1.6},
    {"log, very near 1", pm_log_of, pm_log, logl, 1 - 1e-6, 1 + 1e-6},
    {"log, subnormal", pm_log_of, pm_log, logl, 0, 1e-307},
    {"sin", pm_sin_of, pm_sin, sinl, -10, 10},
    {"sin, small", pm_sin_of, pm_sin, sinl, -1e-3, 1e-3},
    {"sin, near pi", pm_sin_of, pm_sin, sinl, 3.1415, 3.1417},
    {"sin, many turns", pm_sin_of, pm_sin, sinl, -1.6e6, 1.6e6},
    {"cos", pm_cos_of, pm_cos, cosl, -10, 10},
    {"cos, near pi/2", pm_cos_of, pm_cos, cosl, 1.5707, 1.5709},
    {"cos, many turns", pm_cos_of, pm_cos, cosl, -1.6e6, 1.6e6},
    {"log, large", pm_log_of, pm_log, logl, 1e300, 1.7e308},
};

static void test_accuracy(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    for (size_t f = 0; f < sizeof functions / sizeof functions[0]; ++f) {
        double worst = 0, at = 0;
        for (int i = 0; i < SAMPLES; ++i) {
            const function *t = &functions[f];
            const double x = t->low + (t->high - t->low) * pm_rng_uniform(&rng);
            const long double exact = t->exact(x);
            const double error = (double)fabsl((t->plain(x) - exact) / exact) / 0x1p-52;
            if (!(error <= worst)) {
                worst = error;
                at = x;
            }
        }
        if (!(worst <= TOLERANCE)) {
            fail_msg("%s: error of %g units in the last place at %.17g", functions[f].name, worst,
                     at);
        }
    }
}

static void test_same_bits_in_arrays(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 2, 0);
    for (size_t f = 0; f < sizeof functions / sizeof functions[0]; ++f) {
        const function *t = &functions[f];
        for (int n = 1; n <= LONGEST; ++n) {
            pm_graph *g = NULL;
            pm_program *p = NULL;
            assert_int_equal(pm_graph_open(&g), PM_OK);
            const pm_node input = pm_input(g, true, 1, 1), output = t->node(g, input);
            assert_int_equal(pm_program_open(&p, g, 1, &output, n), PM_OK);
            double *x = pm_program_value(p, input);
            for (int i = 0; i < n; ++i) {
                x[i] = t->low + (t->high - t->low) * pm_rng_uniform(&rng);
            }
            pm_program_run(p, n);
            for (int i = 0; i < n; ++i) {
                const double alone = t->plain(x[i]);
                assert_memory_equal(&alone, &pm_program_value(p, output)[i], sizeof alone);
            }
            pm_program_close(p);
            pm_graph_close(g);
        }
    }
}

static void test_limits(void **state) {
    (void)state;
    assert_true(pm_tanh_of(0) == 0 && pm_tanh_of(1e308) == 1 && pm_tanh_of(-INFINITY) == -1);
    assert_true(pm_exp_of(0) == 1 && pm_exp_of(-1e9) > 0 && pm_exp_of(-1e9) < 1e-300);
    assert_true(!isfinite(pm_exp_of(1e9)));
    assert_true(pm_sigmoid_of(0) == 0.5 && pm_sigmoid_of(1e9) == 1);
    assert_true(pm_softplus_of(1000) == 1000 && pm_softplus_of(-1000) >= 0);
    assert_true(isnan(pm_tanh_of(NAN)) && isnan(pm_exp_of(NAN)) && isnan(pm_sigmoid_of(NAN)));
    assert_true(isnan(pm_softplus_of(NAN)));
    assert_true(pm_log_of(1) == 0 && pm_log_of(0) == -INFINITY && pm_log_of(-0.0) == -INFINITY);
    assert_true(pm_log_of(INFINITY) == INFINITY && isnan(pm_log_of(-1)) && isnan(pm_log_of(NAN)));
    assert_true(isnan(pm_log_of(-INFINITY)) && isnan(pm_log_of(-1e-310)));
    assert_true(pm_sin_of(0) == 0 && pm_cos_of(0) == 1 && isnan(pm_sin_of(NAN)));
    assert_true(isnan(pm_sin_of(INFINITY)) && isnan(pm_cos_of(-INFINITY)));
    for (double x = 1; x < 1e308; x *= 3) {
        assert_true(fabs(pm_sin_of(x)) <= 1 && fabs(pm_cos_of(-x)) <= 1);
        assert_true(x > 1e12 || fabs(pm_sin_of(x) - sin(x)) <= 0x1p-50 + x * 0x1p-53);
    }
    for (double x = 1e-300; x < 1; x *= 7) {
        assert_true(pm_tanh_of(-x) == -pm_tanh_of(x));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_accuracy),
        cmocka_unit_test(test_same_bits_in_arrays),
        cmocka_unit_test(test_limits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
