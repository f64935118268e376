// Dense linear algebra: the only caller of CBLAS. Row-major, double.
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

#endif
