// Operators that are one matrix per node are compared with sums written out, and their rounding is
// bounded.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "base/rng.h"
#include "graph/program.h"
#include "model/mesh/nodal.h"

#define NNODE 5
#define ROWS 4 // of two fields
#define COLUMNS 2
#define N (NNODE * ROWS)
// A few rounding errors of numbers around 1.
#define TOLERANCE 1e-13

static const int components[2] = {3, 1};
static const pm_nodal_fields fields = {NNODE, 2, components};

// Returns the position of row r of a node in a row of both fields.
static int place(int node, int r) {
    return r < components[0] ? components[0] * node + r : components[0] * NNODE + node;
}

static void draw(pm_rng *rng, int count, double *value) {
    for (int i = 0; i < count; ++i) {
        value[i] = pm_rng_normal(rng);
    }
}

// Computes (C - C^T) x if columns is 0, else G G^T x.
static void apply(int columns, const double *matrix, const double x[N], double rate[N]) {
    const int size = ROWS * (columns == 0 ? ROWS : columns);
    pm_graph *g = NULL;
    pm_program *p = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node m = pm_input(g, true, NNODE, size), in = pm_input(g, true, 1, N);
    const pm_node out =
        columns == 0 ? pm_nodal_skew(g, fields, m, in) : pm_nodal_square(g, fields, columns, m, in);
    assert_int_equal(pm_program_open(&p, g, 1, &out, 1), PM_OK);
    memcpy(pm_program_value(p, m), matrix, (size_t)(NNODE * size) * sizeof *matrix);
    memcpy(pm_program_value(p, in), x, N * sizeof *x);
    pm_program_run(p, 1);
    memcpy(rate, pm_program_value(p, out), N * sizeof *rate);
    pm_program_close(p);
    pm_graph_close(g);
}

static void assert_close(double value, double expected) {
    if (!(fabs(value - expected) <= TOLERANCE * (1 + fabs(expected)))) {
        fail_msg("%.17g, expected %.17g within %g", value, expected, TOLERANCE);
    }
}

static void skew_and_square_are_the_sums_they_spell(void **state) {
    (void)state;
    pm_rng rng;
    double c[NNODE][ROWS][ROWS], factor[NNODE][ROWS][COLUMNS], x[N], skew[N], square[N];
    pm_rng_init(&rng, 1, 0);
    draw(&rng, NNODE * ROWS * ROWS, c[0][0]);
    draw(&rng, NNODE * ROWS * COLUMNS, factor[0][0]);
    draw(&rng, N, x);
    apply(0, c[0][0], x, skew);
    apply(COLUMNS, factor[0][0], x, square);
    for (int n = 0; n < NNODE; ++n) {
        for (int i = 0; i < ROWS; ++i) {
            double sum[2] = {0, 0};
            for (int j = 0; j < ROWS; ++j) {
                sum[0] += (c[n][i][j] - c[n][j][i]) * x[place(n, j)];
                for (int k = 0; k < COLUMNS; ++k) {
                    sum[1] += factor[n][i][k] * factor[n][j][k] * x[place(n, j)];
                }
            }
            assert_close(skew[place(n, i)], sum[0]);
            assert_close(square[place(n, i)], sum[1]);
        }
    }
}

// The symmetric part of C, however large, leaves no rounding error.
static void the_diagonal_does_not_count(void **state) {
    (void)state;
    pm_rng rng;
    double c[NNODE][ROWS][ROWS], x[N], rate[2][N];
    pm_rng_init(&rng, 2, 0);
    draw(&rng, NNODE * ROWS * ROWS, c[0][0]);
    draw(&rng, N, x);
    apply(0, c[0][0], x, rate[0]);
    for (int n = 0; n < NNODE; ++n) {
        for (int i = 0; i < ROWS; ++i) {
            c[n][i][i] = 1e8 * pm_rng_normal(&rng);
        }
    }
    apply(0, c[0][0], x, rate[1]);
    assert_memory_equal(rate[0], rate[1], sizeof rate[0]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(skew_and_square_are_the_sums_they_spell),
        cmocka_unit_test(the_diagonal_does_not_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
