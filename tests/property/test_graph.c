// Compares the first and second derivatives of every operation with central finite differences, for
// random numbers, and checks that memory planning does not change results.
#include <math.h>
#include <stdlib.h>

#include "base/rng.h"
#include "graph/program.h"
#include "tests/support/unit.h"

#define SEED 20230807u
#define BATCH 3
#define STEP 1e-5
// Central differences: truncation STEP^2 times the third derivative, rounding 1e-16 / STEP.
#define TOLERANCE 2e-8

// A case: an expression of two operands. Entries are positive where the operation needs it.
typedef struct expression {
    const char *name;
    pm_shape a, b;
    bool positive;
    pm_node (*build)(pm_graph *g, pm_node a, pm_node b);
} expression;

static const int some_rows[5] = {2, 0, 1, 1, 2};

static pm_node build_add(pm_graph *g, pm_node a, pm_node b) {
    return pm_add(g, a, b);
}
static pm_node build_sub(pm_graph *g, pm_node a, pm_node b) {
    return pm_sub(g, a, b);
}
static pm_node build_mul(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, a, b);
}
static pm_node build_div(pm_graph *g, pm_node a, pm_node b) {
    return pm_div(g, a, b);
}
static pm_node build_scale(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_scale(g, a, -1.7), b);
}
static pm_node build_offset(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_offset(g, a, 0.3), b);
}
static pm_node build_tanh(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_tanh(g, a), b);
}
static pm_node build_sigmoid(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_sigmoid(g, a), b);
}
static pm_node build_softplus(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_softplus(g, a), b);
}
static pm_node build_silu(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_silu(g, a), b);
}
static pm_node build_exp(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_exp(g, a), b);
}
static pm_node build_log(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_log(g, a), b);
}
static pm_node build_sqrt(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_sqrt(g, a), b);
}
static pm_node build_negative_part(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_mul(g, a, pm_is_negative(g, a)), b);
}
static pm_node build_sum_cols(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_sum_to(g, pm_square(g, a), (pm_shape){true, 3, 1}), b);
}
static pm_node build_sum_batch(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_sum_to(g, pm_square(g, a), (pm_shape){false, 1, 4}), b);
}
static pm_node build_broadcast(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_broadcast_to(g, a, (pm_shape){true, 3, 4}), b);
}
static pm_node build_dot(pm_graph *g, pm_node a, pm_node b) {
    return pm_tanh(g, pm_dot(g, a, b));
}
static pm_node build_matmul(pm_graph *g, pm_node a, pm_node b) {
    return pm_matmul(g, a, false, b, false);
}
static pm_node build_matmul_ta(pm_graph *g, pm_node a, pm_node b) {
    return pm_matmul(g, a, true, b, false);
}
static pm_node build_matmul_tb(pm_graph *g, pm_node a, pm_node b) {
    return pm_matmul(g, a, false, b, true);
}
static pm_node build_matmul_tt(pm_graph *g, pm_node a, pm_node b) {
    return pm_matmul(g, a, true, b, true);
}
static pm_node build_matmul_sum(pm_graph *g, pm_node a, pm_node b) {
    return pm_tanh(g, pm_matmul_sum(g, a, b));
}
static pm_node build_reshape(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_reshape(g, pm_square(g, a), 4, 3), b);
}
static pm_node build_slice(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_slice(g, pm_square(g, a), 1, 2), b);
}
static pm_node build_place(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_place(g, pm_square(g, a), 1, 6), b);
}
static pm_node build_concat(pm_graph *g, pm_node a, pm_node b) {
    const pm_node part[3] = {a, pm_square(g, b), a};
    return pm_square(g, pm_concat(g, 3, part));
}
static pm_node build_gather(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_gather_rows(g, pm_square(g, a), 5, some_rows), b);
}
static pm_node build_scatter(pm_graph *g, pm_node a, pm_node b) {
    return pm_mul(g, pm_scatter_add_rows(g, pm_square(g, a), 3, 5, some_rows), b);
}

#define BATCHED(rows, cols) \
    { true, rows, cols }
#define SHARED(rows, cols) \
    { false, rows, cols }

static const expression expressions[] = {
    {"add", BATCHED(3, 4), SHARED(1, 4), false, build_add},
    {"sub, batched row", SHARED(3, 1), BATCHED(1, 4), false, build_sub},
    {"mul", BATCHED(3, 4), BATCHED(3, 4), false, build_mul},
    {"mul, broadcast", BATCHED(3, 1), SHARED(1, 4), false, build_mul},
    {"mul, one number", BATCHED(3, 4), SHARED(1, 1), false, build_mul},
    {"div", BATCHED(3, 4), BATCHED(3, 4), true, build_div},
    {"div, broadcast", SHARED(1, 4), BATCHED(3, 1), true, build_div},
    {"scale", BATCHED(3, 4), SHARED(3, 4), false, build_scale},
    {"offset", BATCHED(3, 4), BATCHED(3, 4), false, build_offset},
    {"tanh", BATCHED(3, 4), BATCHED(3, 4), false, build_tanh},
    {"sigmoid", BATCHED(3, 4), SHARED(3, 4), false, build_sigmoid},
    {"softplus", BATCHED(3, 4), SHARED(3, 4), false, build_softplus},
    {"silu", BATCHED(3, 4), SHARED(3, 4), false, build_silu},
    {"exp", BATCHED(3, 4), SHARED(3, 4), false, build_exp},
    {"log", BATCHED(3, 4), SHARED(3, 4), true, build_log},
    {"sqrt", SHARED(3, 4), BATCHED(3, 4), true, build_sqrt},
    {"negative part", BATCHED(3, 4), SHARED(3, 4), false, build_negative_part},
    {"sum over columns", BATCHED(3, 4), BATCHED(3, 1), false, build_sum_cols},
    {"sum over batch and rows", BATCHED(3, 4), SHARED(1, 4), false, build_sum_batch},
    {"broadcast a shared row", SHARED(1, 4), BATCHED(3, 4), false, build_broadcast},
    {"broadcast a column", BATCHED(3, 1), BATCHED(3, 4), false, build_broadcast},
    {"dot", BATCHED(3, 4), BATCHED(3, 4), false, build_dot},
    {"dot with a shared row", BATCHED(3, 4), SHARED(1, 4), false, build_dot},
    {"matmul batched x shared", BATCHED(3, 4), SHARED(4, 2), false, build_matmul},
    {"matmul batched x shared^T", BATCHED(3, 4), SHARED(2, 4), false, build_matmul_tb},
    {"matmul batched^T x shared", BATCHED(4, 3), SHARED(4, 2), false, build_matmul_ta},
    {"matmul batched x batched", BATCHED(3, 4), BATCHED(4, 2), false, build_matmul},
    {"matmul batched^T x batched", BATCHED(4, 3), BATCHED(4, 2), false, build_matmul_ta},
    {"matmul batched x batched^T", BATCHED(3, 4), BATCHED(2, 4), false, build_matmul_tb},
    {"matmul batched^T x batched^T", BATCHED(4, 3), BATCHED(2, 4), false, build_matmul_tt},
    {"matmul shared x batched", SHARED(3, 4), BATCHED(4, 2), false, build_matmul},
    {"matmul shared^T x shared", SHARED(4, 3), SHARED(4, 2), false, build_matmul_ta},
    {"matmul_sum", BATCHED(3, 4), BATCHED(3, 2), false, build_matmul_sum},
    {"reshape", BATCHED(3, 4), BATCHED(4, 3), false, build_reshape},
    {"slice", BATCHED(3, 4), BATCHED(3, 2), false, build_slice},
    {"slice, one row", BATCHED(1, 4), BATCHED(1, 2), false, build_slice},
    {"place", BATCHED(3, 4), BATCHED(3, 6), false, build_place},
    {"concat", BATCHED(3, 4), SHARED(3, 2), false, build_concat},
    {"gather rows", BATCHED(3, 4), BATCHED(5, 4), false, build_gather},
    {"scatter-add rows", BATCHED(5, 4), BATCHED(3, 4), false, build_scatter},
};

static size_t size_of(pm_shape shape, int batch) {
    return (size_t)(shape.rows * shape.cols * (shape.batched ? batch : 1));
}

static void fill(pm_rng *rng, double *value, size_t n, bool positive) {
    for (size_t i = 0; i < n; ++i) {
        value[i] = positive ? 0.5 + pm_rng_uniform(rng) : 2 * pm_rng_uniform(rng) - 1;
    }
}

// loss = sum over everything of tanh(w * y): nonlinear, so that second derivatives do not vanish.
static pm_node make_loss(pm_graph *g, const expression *e, pm_node a, pm_node b) {
    const pm_node y = e->build(g, a, b);
    const pm_node bent = pm_add(g, y, pm_scale(g, pm_square(g, y), 0.3));
    return pm_sum_to(g, bent, (pm_shape){false, 1, 1});
}

// Checks d(scalar)/dx, given as a program output, by moving every entry of x.
static void check_by_differences(const expression *e, const char *what, pm_program *p,
                                 pm_node scalar, pm_node x, size_t nx, pm_node dx, int batch) {
    double *value = pm_program_value(p, x);
    double analytic[64];
    assert_true(nx <= 64);
    pm_program_run(p, batch);
    for (size_t i = 0; i < nx; ++i) {
        analytic[i] = pm_program_value(p, dx)[i];
    }
    for (size_t i = 0; i < nx; ++i) {
        const double kept = value[i];
        value[i] = kept + STEP;
        pm_program_run(p, batch);
        const double above = *pm_program_value(p, scalar);
        value[i] = kept - STEP;
        pm_program_run(p, batch);
        const double below = *pm_program_value(p, scalar);
        value[i] = kept;
        const double numeric = (above - below) / (2 * STEP);
        const double error = fabs(analytic[i] - numeric) / fmax(1, fabs(numeric));
        if (!(error < TOLERANCE)) {
            fail_msg("%s, %s, entry %zu: %.12g, by differences %.12g, error %.2g > %.2g, seed %u",
                     e->name, what, i, analytic[i], numeric, error, TOLERANCE, SEED);
        }
    }
}

static void check_expression(const expression *e, uint64_t stream, int batch) {
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node x[2] = {pm_input(g, e->a.batched, e->a.rows, e->a.cols),
                          pm_input(g, e->b.batched, e->b.rows, e->b.cols)};
    const pm_node loss = make_loss(g, e, x[0], x[1]);
    pm_node first[2];
    pm_gradient(g, loss, PM_NO_NODE, 2, x, first);
    // Second order: the gradient of a weighted sum of squares of the gradient.
    pm_node scalar = PM_NO_NODE, second[2];
    for (int i = 0; i < 2; ++i) {
        assert_true(first[i] != PM_NO_NODE);
        scalar =
            pm_add_or(g, scalar, pm_sum_to(g, pm_square(g, first[i]), (pm_shape){false, 1, 1}));
    }
    pm_gradient(g, scalar, PM_NO_NODE, 2, x, second);

    const pm_node output[6] = {loss, first[0], first[1], scalar, second[0], second[1]};
    pm_program *p = NULL;
    assert_int_equal(pm_program_open(&p, g, 6, output, batch), PM_OK);
    pm_rng rng;
    pm_rng_init(&rng, SEED, stream);
    const size_t n[2] = {size_of(e->a, batch), size_of(e->b, batch)};
    for (int i = 0; i < 2; ++i) {
        fill(&rng, pm_program_value(p, x[i]), n[i], e->positive);
    }
    for (int i = 0; i < 2; ++i) {
        check_by_differences(e, "first derivative", p, loss, x[i], n[i], first[i], batch);
        check_by_differences(e, "second derivative", p, scalar, x[i], n[i], second[i], batch);
    }
    pm_program_close(p);
    pm_graph_close(g);
}

static void test_derivatives(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof expressions / sizeof *expressions; ++i) {
        check_expression(&expressions[i], i, BATCH);
        check_expression(&expressions[i], i, 1);
    }
}

// A long chain with many values alive at different times gives the same numbers whether every
// intermediate is kept (all are outputs) or memory is reused.
static void test_memory_reuse(void **state) {
    (void)state;
    enum { LENGTH = 40, WIDTH = 5 };
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node x = pm_input(g, true, 1, WIDTH);
    pm_node chain[LENGTH];
    pm_node last = x;
    for (int i = 0; i < LENGTH; ++i) {
        const pm_node other = i >= 7 ? chain[i - 7] : x;
        const pm_node head = pm_slice(g, last, i % (WIDTH - 1), 1);
        chain[i] = last = pm_tanh(g, pm_add(g, pm_mul(g, last, head), pm_scale(g, other, 0.5)));
    }
    for (int batch = 1; batch <= 4; batch += 3) {
        pm_program *kept = NULL, *reused = NULL;
        assert_int_equal(pm_program_open(&kept, g, LENGTH, chain, batch), PM_OK);
        assert_int_equal(pm_program_open(&reused, g, 1, &last, batch), PM_OK);
        assert_true(pm_program_bytes(reused) < pm_program_bytes(kept));
        pm_rng rng;
        pm_rng_init(&rng, SEED, 1000);
        fill(&rng, pm_program_value(kept, x), (size_t)(batch * WIDTH), false);
        for (int i = 0; i < batch * WIDTH; ++i) {
            pm_program_value(reused, x)[i] = pm_program_value(kept, x)[i];
        }
        for (int run = 0; run < 2; ++run) {
            pm_program_run(kept, batch);
            pm_program_run(reused, batch);
            assert_memory_equal(pm_program_value(kept, last), pm_program_value(reused, last),
                                sizeof(double) * (size_t)(batch * WIDTH));
        }
        pm_program_close(kept);
        pm_program_close(reused);
    }
    pm_graph_close(g);
}

// What no output needs is not computed, and equal expressions are computed once.
static void test_dead_and_shared_results(void **state) {
    (void)state;
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const int batch = 2, cols = 30;
    const pm_node x = pm_input(g, true, 1, cols);
    const pm_node wanted = pm_tanh(g, pm_matmul(g, x, false, x, true));
    assert_int_equal(pm_tanh(g, pm_matmul(g, x, false, x, true)), wanted);
    pm_exp(g, pm_matmul(g, x, true, x, false)); // dead
    pm_program *p = NULL;
    assert_int_equal(pm_program_open(&p, g, 1, &wanted, batch), PM_OK);
    // It takes as much memory as without the dead nodes, because nothing else is computed.
    pm_graph *plain = NULL;
    pm_program *q = NULL;
    assert_int_equal(pm_graph_open(&plain), PM_OK);
    const pm_node y = pm_input(plain, true, 1, cols);
    const pm_node same = pm_tanh(plain, pm_matmul(plain, y, false, y, true));
    assert_int_equal(pm_program_open(&q, plain, 1, &same, batch), PM_OK);
    assert_int_equal(pm_program_bytes(p), pm_program_bytes(q));
    pm_program_close(p);
    pm_program_close(q);
    pm_graph_close(plain);
    pm_graph_close(g);
}

// A node that depends on weights alone keeps its numbers until the program is prepared again,
// though the memory of other nodes is reused around it.
static void test_prepared_weights(void **state) {
    (void)state;
    pm_graph *g = NULL;
    pm_program *p = NULL;
    double weight[2] = {1, 2};
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node x = pm_input(g, true, 1, 2), w = pm_param(g, weight, 1, 2);
    const pm_node early = pm_exp(g, pm_mul(g, x, x));
    const pm_node fixed = pm_scale(g, pm_offset(g, w, 1), 10); // 20, 30
    const pm_node y = pm_add(g, pm_mul(g, pm_log(g, early), fixed), pm_sqrt(g, early));
    assert_int_equal(pm_program_open(&p, g, 1, &y, 1), PM_OK);
    double *input = pm_program_value(p, x);
    const double *result = pm_program_value(p, y);
    pm_program_prepare(p);
    weight[0] = 7;
    for (int i = 1; i < 4; ++i) {
        input[0] = input[1] = i;
        pm_program_run_prepared(p, 1);
        assert_true(fabs(result[0] - (20 * i * i + exp(0.5 * i * i))) < 1e-10);
        assert_true(fabs(result[1] - (30 * i * i + exp(0.5 * i * i))) < 1e-10);
    }
    pm_program_run(p, 1);
    assert_true(fabs(result[0] - (80 * 9 + exp(4.5))) < 1e-10);
    pm_program_close(p);
    pm_graph_close(g);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_derivatives),
        cmocka_unit_test(test_memory_reuse),
        cmocka_unit_test(test_dead_and_shared_results),
        cmocka_unit_test(test_prepared_weights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
