// The two fits of a basis: linear least squares of low rank, and the kernel of the stress close to
// loads.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "bodies/modal/local.h"
#include "bodies/modal/reduce.h"
#include "tests/support/unit.h"

// Nodes at x = 0..4, y and z = -1, 0, 1.
enum { NX = 5, NNODE = NX * 9 };

// The stress at a place is the convolution of the forces of its own and the neighbouring sections
// with the kernel.
static void local_stress_is_a_convolution(void **state) {
    (void)state;
    double position[NNODE][3];
    for (int i = 0; i < NNODE; ++i) {
        position[i][0] = i % NX;
        position[i][1] = i / NX % 3 - 1;
        position[i][2] = i / NX / 3 - 1;
    }
    pm_arena arena = {0};
    pm_local l = {0};
    int carries[NNODE] = {0};
    carries[3] = carries[NX + 1] = 1; // places 0 and 1 of the section
    assert_int_equal(pm_local_find_sections(&l, NNODE, position[0], &arena), PM_OK);
    assert_int_equal(pm_local_set_loaded(&l, carries, 1, &arena), PM_OK);
    assert_true(l.nsection == NX && l.nper == 9 && l.nloaded == 2);
    pm_rng rng;
    pm_rng_init(&rng, 8, 0);
    for (int i = 0; i < pm_local_features(&l) * 9 * 6; ++i) {
        l.kernel[i] = pm_rng_normal(&rng);
    }
    double f[3 * NNODE], stress[6 * NNODE] = {0};
    for (int i = 0; i < 3 * NNODE; ++i) {
        f[i] = pm_rng_normal(&rng);
    }
    double *work = calloc(pm_local_work(&l), sizeof *work);
    pm_local_add(&l, f, stress, work);
    free(work);
    for (int node = 0; node < NNODE; ++node) {
        const int section = node % NX, place = node / NX;
        for (int c = 0; c < 6; ++c) {
            double expected = 0;
            for (int at = section - 1; at <= section + 1; ++at) {
                for (int k = 0; k < 6 && at >= 0 && at < NX; ++k) { // two places, three components
                    const int feature = (at - section + 1) * 6 + k;
                    expected += f[3 * (at + NX * (k / 3)) + k % 3] *
                                l.kernel[(feature * 9 + place) * 6 + c];
                }
            }
            assert_true(fabs(stress[6 * node + c] - expected) < 1e-12);
        }
    }
    pm_arena_free(&arena);
    position[NX + 2][0] += 0.5;
    pm_local bent = {0};
    assert_int_equal(pm_local_find_sections(&bent, NNODE, position[0], &arena), PM_EDATA);
    assert_non_null(strstr(pm_error(), "not prismatic"));
    pm_arena_free(&arena);
}

// Results of rank two are found from four features, of which two matter.
static void regression_finds_what_is_there(void **state) {
    (void)state;
    enum { P = 4, M = 5, N = 40 };
    double x[N][P], y[N][M], coefficient[P * 2], pattern[2 * M];
    pm_rng rng;
    pm_rng_init(&rng, 3, 0);
    for (int i = 0; i < N; ++i) {
        for (int j = 0; j < P; ++j) {
            x[i][j] = pm_rng_normal(&rng);
        }
        for (int j = 0; j < M; ++j) {
            y[i][j] = (j + 1) * x[i][0] - j * j * x[i][2];
        }
    }
    pm_regression r;
    assert_int_equal(pm_regression_open(&r, P, M), PM_OK);
    pm_regression_add(&r, N / 2, x[0], y[0]);
    pm_regression_add(&r, N / 2, x[N / 2], y[N / 2]);
    assert_int_equal(pm_regression_solve(&r, 0), PM_OK);
    assert_int_equal(pm_regression_compress(&r, 2, coefficient, pattern), PM_OK);
    for (int i = 0; i < P; ++i) {
        for (int j = 0; j < M; ++j) {
            const double expected = i == 0 ? j + 1 : i == 2 ? -j * j : 0;
            const double low_rank =
                coefficient[2 * i] * pattern[j] + coefficient[2 * i + 1] * pattern[M + j];
            assert_true(fabs(r.cross[i * M + j] - expected) < 1e-9);
            assert_true(fabs(low_rank - expected) < 1e-7);
        }
    }
    pm_regression_close(&r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(local_stress_is_a_convolution),
        cmocka_unit_test(regression_finds_what_is_there),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
