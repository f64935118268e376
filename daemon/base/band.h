// Symmetric positive definite matrices in which only the diagonal and `width` diagonals on each
// side are not zero, for iterations that correct a solution. band [n][width + 1] holds the columns
// from the diagonal down.
#ifndef PM_BASE_BAND_H
#define PM_BASE_BAND_H

#include <stdbool.h>

// Computes the Cholesky factor of `band`, which it overwrites, in double precision (LAPACK's
// dpbtrf), and rounds it to factor [n][width + 1]. Returns false if the matrix is not positive
// definite; then `factor` does not change.
bool pm_band_factor(int n, int width, double *band, float *factor);
// Solves for one right-hand side x [n] with the factor, in double precision. The rounding of the
// factor remains: the relative error is about 1e-7 times the condition of the matrix.
void pm_band_solve(int n, int width, const float *factor, double *x);

#endif
