// Dense linear algebra: the only caller of CBLAS and LAPACK. Row-major, double.
#ifndef PM_BASE_LINALG_H
#define PM_BASE_LINALG_H

#include <stdbool.h>

// Programs call this once at start: one BLAS thread (its own threads cost far more than they give
// on small matrices, and would change the order of sums).
void pm_linalg_init(void);

// c [m][n] = op(a) op(b) with op(a) [m][k], op(b) [k][n]; a, b, c are contiguous and do not
// overlap. Products too small to be worth a BLAS call are done here, in an order of sums of their
// own.
void pm_gemm(bool transpose_a, bool transpose_b, int m, int n, int k, const double *a,
             const double *b, double *c);

// h [n][n] += j^T j with j [m][n]; only the upper triangle is touched.
void pm_gram_add(int m, int n, const double *j, double *h);

// h = u^T u for symmetric positive definite h [n][n], given by its upper triangle, which becomes u.
// False if h is not positive definite.
bool pm_cholesky_factor(int n, double *h);
// Solves u^T u x = b for count right hand sides; b [n][count] becomes x.
void pm_cholesky_back(int n, const double *u, int count, double *b);

// Solves h x = b for symmetric positive definite h [n][n], given by its upper triangle, which is
// overwritten; b [n] becomes x. False if h is not positive definite.
bool pm_cholesky_solve(int n, double *h, double *b);

// The `count` largest eigenvalues [count] of symmetric h [n][n], given by its upper triangle, which
// is overwritten, in descending order; their eigenvectors, orthonormal, are the rows of
// vector [count][n]. False if out of memory, or it does not converge.
bool pm_eigen_largest(int n, double *h, int count, double *value, double *vector);

#endif
