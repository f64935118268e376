// Matrix products and Cholesky factors by CBLAS, eigenvectors by LAPACK. Small products run in
// plain loops that the compiler vectorises.
#include "base/linalg.h"

#include <cblas.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "base/arena.h"
#include "base/simd.h"

#define CHOLESKY_BLOCK 64

void pm_linalg_init(void) {
    openblas_set_num_threads(1);
}

// Sums WIDTH columns of one row of c, from column j on, and keeps them in registers meanwhile.
#define SUM_COLUMNS(WIDTH)                                        \
    {                                                             \
        double sum[WIDTH] = {0};                                  \
        for (int l = 0; l < k; ++l) {                             \
            const double factor = a_i[l * a_col];                 \
            for (int v = 0; v < (WIDTH); ++v) {                   \
                sum[v] += factor * b[(ptrdiff_t)l * n + (j + v)]; \
            }                                                     \
        }                                                         \
        memcpy(row + j, sum, sizeof sum);                         \
        j += (WIDTH);                                             \
    }

// Computes c = a b; vectorises along the rows of b.
PM_SIMD_CLONES static void small_nn(int m, int n, int k, const double *a, ptrdiff_t a_row,
                                    ptrdiff_t a_col, const double *restrict b, double *restrict c) {
    for (int i = 0; i < m; ++i) {
        const double *a_i = a + i * a_row;
        double *restrict row = c + (ptrdiff_t)i * n;
        int j = 0;
        while (j + PM_LANES <= n) {
            SUM_COLUMNS(PM_LANES)
        }
        if (j + 4 <= n) {
            SUM_COLUMNS(4)
        }
        if (j + 2 <= n) {
            SUM_COLUMNS(2)
        }
        if (j < n) {
            SUM_COLUMNS(1)
        }
    }
}

// Returns the inner product of x and y [k], with PM_LANES partial sums in a fixed order. The
// remainder of k modulo PM_LANES is gathered separately, so that the partial sums stay in
// registers.
static inline double inner(int k, const double *restrict x, ptrdiff_t stride,
                           const double *restrict y) {
    double lane[PM_LANES] = {0};
    int l = 0;
    for (; l + PM_LANES <= k; l += PM_LANES) {
        for (int i = 0; i < PM_LANES; ++i) {
            lane[i] += x[(l + i) * stride] * y[l + i];
        }
    }
    if (l < k) {
        double rest[PM_LANES] = {0};
        for (int i = 0; l + i < k; ++i) {
            rest[i] = x[(l + i) * stride] * y[l + i];
        }
        for (int i = 0; i < PM_LANES; ++i) {
            lane[i] += rest[i];
        }
    }
    return ((lane[0] + lane[4]) + (lane[1] + lane[5])) +
           ((lane[2] + lane[6]) + (lane[3] + lane[7]));
}

// Returns the same inner product, bit by bit, for k < 4.
static inline double short_inner(int k, const double *restrict x, ptrdiff_t stride,
                                 const double *restrict y) {
    double sum = 0;
    for (int l = 0; l < k; ++l) {
        sum += 0 + x[l * stride] * y[l];
    }
    return sum;
}

// Computes c = a b^T by transposing b first, for more than a few rows.
static void small_nt_rows(int m, int n, int k, const double *a, ptrdiff_t a_row, ptrdiff_t a_col,
                          const double *b, double *c) {
    double transposed[PM_SMALL_PRODUCT / PM_MANY_ROWS];
    for (int j = 0; j < n; ++j) {
        for (int l = 0; l < k; ++l) {
            transposed[l * n + j] = b[j * k + l];
        }
    }
    small_nn(m, n, k, a, a_row, a_col, transposed, c);
}

// Computes c = a b^T with one inner product per entry.
PM_SIMD_CLONES static void small_nt(int m, int n, int k, const double *a, ptrdiff_t a_row,
                                    ptrdiff_t a_col, const double *b, double *c) {
    for (int i = 0; i < m; ++i) {
        for (int j = 0; j < n; ++j) {
            const double *b_row = b + (ptrdiff_t)j * k;
            if (k < 4) {
                c[(ptrdiff_t)i * n + j] = short_inner(k, a + i * a_row, a_col, b_row);
                continue;
            }
            // A literal stride of 1 compiles to vector loads.
            c[(ptrdiff_t)i * n + j] = a_col == 1 ? inner(k, a + i * a_row, 1, b_row)
                                                 : inner(k, a + i * a_row, a_col, b_row);
        }
    }
}

// Computes c = a b for k = 1, where the other functions would form inner products of one number.
PM_SIMD_CLONES static void small_outer(int m, int n, const double *restrict a,
                                       const double *restrict b, double *restrict c) {
    for (int i = 0; i < m; ++i) {
        for (int j = 0; j < n; ++j) {
            c[(ptrdiff_t)i * n + j] = 0 + a[i] * b[j];
        }
    }
}

void pm_gemm(bool transpose_a, bool transpose_b, int m, int n, int k, const double *a,
             const double *b, double *c) {
    if ((long)m * n * k > PM_SMALL_PRODUCT) {
        cblas_dgemm(CblasRowMajor, transpose_a ? CblasTrans : CblasNoTrans,
                    transpose_b ? CblasTrans : CblasNoTrans, m, n, k, 1.0, a, transpose_a ? m : k,
                    b, transpose_b ? k : n, 0.0, c, n);
        return;
    }
    const ptrdiff_t a_row = transpose_a ? 1 : k;
    const ptrdiff_t a_col = transpose_a ? m : 1;
    if (k == 1) {
        small_outer(m, n, a, b, c);
    } else if (transpose_b && m >= PM_MANY_ROWS) {
        small_nt_rows(m, n, k, a, a_row, a_col, b, c);
    } else if (transpose_b) {
        small_nt(m, n, k, a, a_row, a_col, b, c);
    } else {
        small_nn(m, n, k, a, a_row, a_col, b, c);
    }
}

void pm_gram_add(int m, int n, const double *j, double *h) {
    cblas_dsyrk(CblasRowMajor, CblasUpper, CblasTrans, n, m, 1.0, j, n, 1.0, h, n);
}

// Factors one block on the diagonal of h [n][stride], h = u^T u; false if it is not positive
// definite.
static bool factor_block(int n, double *h, int stride) {
    for (int i = 0; i < n; ++i) {
        double *row = h + (ptrdiff_t)i * stride;
        if (!(row[i] > 0)) {
            return false;
        }
        const double root = sqrt(row[i]);
        for (int j = i; j < n; ++j) {
            row[j] /= root;
        }
        for (int k = i + 1; k < n; ++k) {
            for (int j = k; j < n; ++j) {
                h[(ptrdiff_t)k * stride + j] -= row[k] * row[j];
            }
        }
    }
    return true;
}

bool pm_cholesky_factor(int n, double *h) {
    // Right-looking block factorisation h = u^T u (Golub, Van Loan, Matrix Computations, 4.2.6).
    for (int k = 0; k < n; k += CHOLESKY_BLOCK) {
        const int size = n - k < CHOLESKY_BLOCK ? n - k : CHOLESKY_BLOCK;
        const int rest = n - k - size;
        double *diagonal = h + (ptrdiff_t)k * n + k, *right = diagonal + size;
        if (!factor_block(size, diagonal, n)) {
            return false;
        }
        if (rest > 0) {
            cblas_dtrsm(CblasRowMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, size, rest,
                        1.0, diagonal, n, right, n);
            cblas_dsyrk(CblasRowMajor, CblasUpper, CblasTrans, rest, size, -1.0, right, n, 1.0,
                        right + (ptrdiff_t)size * n, n);
        }
    }
    return true;
}

void pm_cholesky_back(int n, const double *u, int count, double *b) {
    cblas_dtrsm(CblasRowMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, n, count, 1.0, u, n,
                b, count);
    cblas_dtrsm(CblasRowMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, n, count, 1.0, u,
                n, b, count);
}

bool pm_cholesky_solve(int n, double *h, double *b) {
    if (!pm_cholesky_factor(n, h)) {
        return false;
    }
    cblas_dtrsv(CblasRowMajor, CblasUpper, CblasTrans, CblasNonUnit, n, h, n, b, 1);
    cblas_dtrsv(CblasRowMajor, CblasUpper, CblasNoTrans, CblasNonUnit, n, h, n, b, 1);
    return true;
}

// LAPACK's eigensolver, which stores matrices by columns.
void dsyevr_(const char *job, const char *range, const char *triangle, const int *n, double *a,
             const int *lda, const double *lowest, const double *highest, const int *first,
             const int *last, const double *tolerance, int *found, double *value, double *vector,
             const int *ldz, int *support, double *work, const int *nwork, int *iwork,
             const int *niwork, int *info);

bool pm_eigen_largest(int n, double *h, int count, double *value, double *vector) {
    const int first = n - count + 1, nwork = 26 * n, niwork = 10 * n;
    const double unused = 0, tolerance = 0;
    int found = 0, info = 1;
    pm_arena arena = {0};
    double *work = pm_arena_array(&arena, (size_t)nwork, sizeof *work);
    double *all = pm_arena_array(&arena, (size_t)n, sizeof *all);
    int *iwork = pm_arena_array(&arena, (size_t)niwork, sizeof *iwork);
    int *support = pm_arena_array(&arena, 2 * (size_t)n, sizeof *support);
    if (!arena.failed) {
        // The upper triangle stored by rows is the lower one stored by columns.
        dsyevr_("V", "I", "L", &n, h, &n, &unused, &unused, &first, &n, &tolerance, &found, all,
                vector, &n, support, work, &nwork, iwork, &niwork, &info);
    }
    const bool good = info == 0 && found == count;
    for (int i = 0; good && i < count; ++i) {
        value[i] = all[count - 1 - i];
    }
    for (int i = 0; good && i < count / 2; ++i) {
        double *a = vector + (ptrdiff_t)i * n, *b = vector + (ptrdiff_t)(count - 1 - i) * n;
        for (int j = 0; j < n; ++j) {
            const double kept = a[j];
            a[j] = b[j];
            b[j] = kept;
        }
    }
    pm_arena_free(&arena);
    return good;
}

static int compare(const void *left, const void *right) {
    const double a = *(const double *)left, b = *(const double *)right;
    if (isnan(a) || isnan(b)) {
        return isnan(a) - isnan(b);
    }
    return (a > b) - (a < b);
}

void pm_sort(size_t n, double *value) {
    qsort(value, n, sizeof *value, compare);
}
