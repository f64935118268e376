// Solutions with the Cholesky factor L of a band matrix: L y = b by columns, then L^T x = y. The
// time of a solution is that of reading the factor, which single precision halves; four columns at
// a time read the vector once instead of four times.
#include "base/band.h"

#include <stddef.h>
#include <string.h>

#include "base/lanes.h"
#include "base/simd.h"

#define COLUMNS 4

void dpbtrf_(const char *uplo, const int *n, const int *kd, double *ab, const int *ldab, int *info);

bool pm_band_factor(int n, int width, double *band, float *factor) {
    const int rows = width + 1;
    int info = 1;
    dpbtrf_("L", &n, &width, band, &rows, &info);
    for (ptrdiff_t i = 0; i < (ptrdiff_t)n * rows && info == 0; ++i) {
        factor[i] = (float)band[i];
    }
    return info == 0;
}

static int least(int a, int b) {
    return a < b ? a : b;
}

// Eliminates the unknowns of columns j to j + COLUMNS - 1 from the rows below. c[k][i] is entry
// j + i of column j + k, `left` the number of rows from j on.
PM_SIMD_CLONES
static void eliminate(int width, int left, const float *const *c, double *restrict x) {
    double v[COLUMNS];
    for (int k = 0; k < COLUMNS; ++k) {
        v[k] = x[k];
        for (int l = 0; l < k; ++l) {
            v[k] -= c[l][k] * v[l];
        }
        v[k] /= c[k][k];
        x[k] = v[k];
    }
    const float *c0 = c[0], *c1 = c[1], *c2 = c[2], *c3 = c[3];
    const int end = least(left, width + 1);
    for (int i = COLUMNS; i < end; ++i) {
        x[i] -= (c0[i] * v[0] + c1[i] * v[1]) + (c2[i] * v[2] + c3[i] * v[3]);
    }
    for (int k = 1; k < COLUMNS; ++k) {
        for (int i = end; i < least(left, width + 1 + k); ++i) {
            x[i] -= c[k][i] * v[k];
        }
    }
}

// Finds the unknowns of these columns from those of the rows below.
PM_SIMD_CLONES
static void substitute(int width, int left, const float *const *c, double *x) {
    const int end = least(left, width + 1);
    pm_lane sum[COLUMNS] = {{0}};
    double rest[COLUMNS] = {0};
    int i = COLUMNS;
    for (; i + PM_LANES <= end; i += PM_LANES) {
        pm_lane at;
        pm_lanes_load(1, x + i, &at);
        for (int k = 0; k < COLUMNS; ++k) {
            pm_narrow_lane column;
            memcpy(&column, c[k] + i, sizeof column);
            sum[k] += __builtin_convertvector(column, pm_lane) * at;
        }
    }
    for (int k = 0; k < COLUMNS; ++k) {
        for (int l = i; l < least(left, width + 1 + k); ++l) {
            rest[k] += c[k][l] * x[l];
        }
    }
    for (int k = COLUMNS - 1; k >= 0; --k) {
        double v = x[k] - rest[k] - pm_lane_sum(&sum[k]);
        for (int l = k + 1; l < COLUMNS; ++l) {
            v -= c[k][l] * x[l];
        }
        x[k] = v / c[k][k];
    }
}

// Finds the columns from j on, such that c[k][i] is entry j + i of column j + k.
static void find_columns(int width, const float *factor, int j, const float *c[COLUMNS]) {
    for (int k = 0; k < COLUMNS; ++k) {
        c[k] = factor + (ptrdiff_t)(j + k) * (width + 1) - k;
    }
}

void pm_band_solve(int n, int width, const float *factor, double *x) {
    const float *c[COLUMNS];
    const int together = width < COLUMNS ? 0 : n - n % COLUMNS; // the columns that are grouped
    const ptrdiff_t rows = width + 1;
    for (int j = 0; j < together; j += COLUMNS) {
        find_columns(width, factor, j, c);
        eliminate(width, n - j, c, x + j);
    }
    for (int j = together; j < n; ++j) {
        const float *column = factor + j * rows;
        x[j] /= column[0];
        for (int i = 1; i < least(n - j, width + 1); ++i) {
            x[j + i] -= column[i] * x[j];
        }
    }
    for (int j = n - 1; j >= together; --j) {
        const float *column = factor + j * rows;
        for (int i = 1; i < least(n - j, width + 1); ++i) {
            x[j] -= column[i] * x[j + i];
        }
        x[j] /= column[0];
    }
    for (int j = together - COLUMNS; j >= 0; j -= COLUMNS) {
        find_columns(width, factor, j, c);
        substitute(width, n - j, c, x + j);
    }
}
