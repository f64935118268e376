// Linear least squares with many results at once, and the low-rank form of what came out.
#ifndef PM_TRAINER_MODAL_REGRESSION_H
#define PM_TRAINER_MODAL_REGRESSION_H

#include "base/status.h"

// Sums over samples of weight^2 features^T features and weight^2 features^T results.
typedef struct pm_regression {
    int nfeature, nresult;
    double *gram;    // [nfeature][nfeature], upper triangle
    double *cross;   // [nfeature][nresult]
    double *product; // work space
} pm_regression;

// PM_ENOMEM.
pm_status pm_regression_open(pm_regression *r, int nfeature, int nresult);
void pm_regression_close(pm_regression *r);

// Adds samples, already multiplied by their weights: features [count][nfeature], results
// [count][nresult].
void pm_regression_add(pm_regression *r, int count, const double *features, const double *results);

// cross becomes the coefficients [nfeature][nresult] of results = features . coefficients, with a
// ridge of `ridge` times each feature's mean square, and gram its factor. PM_ENUMERIC.
pm_status pm_regression_solve(pm_regression *r, double ridge);

// The best approximation of the solution, over the samples, of the given rank:
// coefficient [nfeature][rank] times pattern [rank][nresult]. PM_ENOMEM, PM_ENUMERIC.
pm_status pm_regression_compress(const pm_regression *r, int rank, double *coefficient,
                                 double *pattern);

#endif
