// Linear least squares with many dependent variables (`results`) by normal equations, and the best
// solution of low rank (reduced-rank regression: Izenman, J. Multivar. Anal. 5, 1975).
#ifndef PM_TRAINER_MODAL_REGRESSION_H
#define PM_TRAINER_MODAL_REGRESSION_H

#include "base/status.h"

// Sums over the samples of features^T features and features^T results, both weighted.
typedef struct pm_regression {
    int nfeature, nresult;
    double *gram;    // [nfeature][nfeature], upper triangle
    double *cross;   // [nfeature][nresult]
    double *product; // [nfeature][nresult] work space
} pm_regression;

// Allocates the sums and sets them to zero. PM_ENOMEM.
pm_status pm_regression_open(pm_regression *r, int nfeature, int nresult);
void pm_regression_close(pm_regression *r);

// Adds samples that are already multiplied by their weights: features [count][nfeature], results
// [count][nresult].
void pm_regression_add(pm_regression *r, int count, const double *features, const double *results);

// Solves for the coefficients in results = features . coefficients, with a ridge of `ridge` times
// the mean square of each feature. `cross` becomes the coefficients [nfeature][nresult] and `gram`
// its Cholesky factor. PM_ENUMERIC.
pm_status pm_regression_solve(pm_regression *r, double ridge);

// Approximates the solution by coefficient [nfeature][rank] times pattern [rank][nresult], the best
// of this rank over the samples. PM_ENOMEM, PM_ENUMERIC.
pm_status pm_regression_compress(const pm_regression *r, int rank, double *coefficient,
                                 double *pattern);

#endif
