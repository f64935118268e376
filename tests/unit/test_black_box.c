// The regression that a fit is compared with, on series whose next row is known.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "inference/black_box.h"
#include "tests/support/unit.h"

#define COUNT 12
#define TRAINING 10
#define NTIME 60
#define MOST 3 // columns of a row
#define GENEROUS 5.0

typedef struct bench {
    double row[COUNT][NTIME][MOST], out[COUNT][NTIME][MOST];
    double *rows[COUNT], *outs[COUNT];
    int ntime[COUNT], given[COUNT];
    pm_black_box_data data;
    pm_black_box chosen;
} bench;

static void bench_open(bench *b, int nvalue, int ninput, int given) {
    memset(b, 0, sizeof *b);
    for (int i = 0; i < COUNT; ++i) {
        b->rows[i] = &b->row[i][0][0];
        b->outs[i] = &b->out[i][0][0];
        b->ntime[i] = NTIME;
        b->given[i] = given;
    }
    b->data = (pm_black_box_data){.nvalue = nvalue,
                                  .ninput = ninput,
                                  .count = COUNT,
                                  .ntraining = TRAINING,
                                  .ntime = b->ntime,
                                  .row = b->rows,
                                  .given = b->given};
}

// Number c of row k of series i, which has `width` columns.
static double *at(bench *b, int i, int k, int width, int c) {
    return b->rows[i] + k * width + c;
}

// Returns the largest error of the runs of the series that did not train.
static double largest_error(bench *b) {
    const int nvalue = b->data.nvalue, width = nvalue + b->data.ninput;
    double largest = 0;
    for (int i = TRAINING; i < COUNT; ++i) {
        for (int k = 0; k < NTIME; ++k) {
            for (int c = 0; c < nvalue; ++c) {
                const double truth = *at(b, i, k, width, c);
                const double error = fabs(b->outs[i][k * nvalue + c] - truth);
                largest = isnan(truth) || error <= largest ? largest : error;
            }
        }
    }
    return largest;
}

// A rotation that is damped, and driven by an input, with a cubic term.
static void fill_oscillator(bench *b) {
    pm_rng rng;
    pm_rng_init(&rng, 3, 0);
    for (int i = 0; i < COUNT; ++i) {
        *at(b, i, 0, 3, 0) = (i < TRAINING ? 1 : 0.7) * (2 * pm_rng_uniform(&rng) - 1);
        for (int k = 0; k < NTIME; ++k) {
            const double x = *at(b, i, k, 3, 0), v = *at(b, i, k, 3, 1);
            const double u = *at(b, i, k, 3, 2) = sin(0.3 * k + i);
            if (k + 1 < NTIME) {
                *at(b, i, k + 1, 3, 0) = x + 0.1 * v;
                *at(b, i, k + 1, 3, 1) = 0.98 * v - 0.1 * x - 0.02 * x * x * x + 0.1 * u;
            }
        }
    }
}

static void a_polynomial_map_is_found(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 2, 1, 1);
    fill_oscillator(&b);
    assert_int_equal(pm_black_box_predict(&b.data, GENEROUS, b.outs, &b.chosen), PM_OK);
    const double error = largest_error(&b);
    if (!(error < 1e-5)) {
        fail_msg("error %g, expected rounding; %s", error, b.chosen.name);
    }
    assert_true(b.chosen.error < log(1e-5));
    assert_true(b.chosen.tried > 2);
    // The same result for another call, and only the cheapest candidate without time.
    const double before = b.out[COUNT - 1][NTIME - 1][0];
    assert_int_equal(pm_black_box_predict(&b.data, GENEROUS, b.outs, &b.chosen), PM_OK);
    assert_true(before == b.out[COUNT - 1][NTIME - 1][0]);
    assert_int_equal(pm_black_box_predict(&b.data, 0, b.outs, &b.chosen), PM_OK);
    assert_int_equal(b.chosen.tried, 1);
}

// A position alone: the velocity is hidden, so that two rows are needed; some numbers are missing.
static void lags_make_up_for_hidden_variables(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 1, 0, 4);
    pm_rng rng;
    pm_rng_init(&rng, 4, 0);
    for (int i = 0; i < COUNT; ++i) {
        const double phase = 6 * pm_rng_uniform(&rng);
        for (int k = 0; k < NTIME; ++k) {
            *at(&b, i, k, 1, 0) = exp(-0.01 * k) * cos(0.2 * k + phase);
        }
        *at(&b, i, 20, 1, 0) = NAN;
    }
    assert_int_equal(pm_black_box_predict(&b.data, GENEROUS, b.outs, &b.chosen), PM_OK);
    const double error = largest_error(&b);
    if (!(error < 1e-4)) {
        fail_msg("error %g, expected a linear recurrence of two rows; %s", error, b.chosen.name);
    }
    assert_null(strstr(b.chosen.name, "lag 1"));
}

static void without_rows_there_is_none(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 2, 1, 1);
    for (int i = 0; i < COUNT; ++i) {
        b.ntime[i] = 1;
    }
    assert_int_equal(pm_black_box_predict(&b.data, 1, b.outs, &b.chosen), PM_EDATA);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_polynomial_map_is_found),
        cmocka_unit_test(lags_make_up_for_hidden_variables),
        cmocka_unit_test(without_rows_there_is_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
