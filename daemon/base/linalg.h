// Dense linear algebra on contiguous, row-major matrices of double. This is the only caller of
// CBLAS and LAPACK. Functions allocate nothing unless they say so. An inner product has PM_LANES
// partial sums: one register of the widest instruction set.
#ifndef PM_BASE_LINALG_H
#define PM_BASE_LINALG_H

#include <stdbool.h>
#include <stddef.h>

#include "base/lanes.h"

// A product of up to this number of multiply-adds is computed here, in an order of sums that is the
// same on every processor. A larger product takes longer than a call of BLAS costs, and therefore
// calls BLAS.
#define PM_SMALL_PRODUCT 4096
// If a product a b^T has at least this many rows, pm_gemm transposes b into a buffer first.
#define PM_MANY_ROWS 4

// Restricts BLAS to one thread; a program calls this once at its start. The threads of BLAS cost
// more than they gain on small matrices and would change the order of sums.
void pm_linalg_init(void);

// Computes c [m][n] = op(a) op(b) with op(a) [m][k] and op(b) [k][n]. op is the transposition if
// transpose_a or transpose_b is true. a, b and c must not overlap. Small products do not call BLAS
// but run here, in a fixed order of sums.
void pm_gemm(bool transpose_a, bool transpose_b, int m, int n, int k, const double *a,
             const double *b, double *c);

// Computes h [n][n] += j^T j with j [m][n]; touches only the upper triangle of h.
void pm_gram_add(int m, int n, const double *j, double *h);

// Replaces the upper triangle of a symmetric positive definite h [n][n] by its Cholesky factor u,
// h = u^T u (Golub and Van Loan, Matrix Computations, 4.2). Returns false if h is not positive
// definite.
bool pm_cholesky_factor(int n, double *h);

// Solves u^T u x = b for `count` right-hand sides with the factor u [n][n] of pm_cholesky_factor;
// b [n][count] becomes x.
void pm_cholesky_back(int n, const double *u, int count, double *b);

// Solves h x = b for one right-hand side and a symmetric positive definite h [n][n]. The upper
// triangle of h is replaced by its Cholesky factor, and b [n] by x. Returns false if h is not
// positive definite.
bool pm_cholesky_solve(int n, double *h, double *b);

// Computes the `count` largest eigenvalues of a symmetric h [n][n], in descending order, into
// value [count], and their orthonormal eigenvectors into the rows of vector [count][n]. Reads the
// upper triangle of h and overwrites h. Allocates work space; returns false if memory is exhausted
// or LAPACK's dsyevr does not converge.
bool pm_eigen_largest(int n, double *h, int count, double *value, double *vector);

// Sorts value [n], the smallest first, and NaN last.
void pm_sort(size_t n, double *value);

#endif
