// A black box to compare with: the next row of a series as a regression on the last rows (a NARX
// model; Chen and Billings, Int. J. Control 49, 1989). Its features are products of Chebyshev
// polynomials of limited total degree, or random hidden units (Huang, Zhu, Siew, Neurocomputing
// 70, 2006). The coefficients are a linear least-squares problem, so that training takes seconds.
#ifndef PM_TRAINER_INFERENCE_BLACK_BOX_H
#define PM_TRAINER_INFERENCE_BLACK_BOX_H

#include "base/status.h"

// Series of rows at equal times. A row holds the values that are predicted, then the inputs.
typedef struct pm_black_box_data {
    int nvalue, ninput;
    int count;          // series
    int ntraining;      // the first so many train; the others, or all if all train, are predicted
    const int *ntime;   // [count] rows of each series
    double *const *row; // [count] -> [ntime][nvalue + ninput]; NaN where a number is missing
    const int *given;   // [count] rows that are known where a prediction begins, at least 1
} pm_black_box_data;

// What was chosen.
typedef struct pm_black_box {
    // The mean, over predicted series and values, of the logarithm of the error of the free run
    // divided by that of persistence from the last known row on.
    double error;
    int tried;     // how many were tried
    char name[80]; // in words
} pm_black_box;

// Trains several black boxes, the cheapest first, for `seconds` of a nominal machine, and chooses
// the one with the least error of free runs. Fills predicted [count] -> [ntime][nvalue] for each
// series that is predicted, and leaves the others as they are: first the known rows, then the free
// run. Once a prediction is not finite, the rest of the series is NaN. The operations are counted,
// so that the result does not depend on the clock. PM_EDATA: there are too few rows to train on;
// PM_ENOMEM.
pm_status pm_black_box_predict(const pm_black_box_data *data, double seconds,
                               double *const *predicted, pm_black_box *chosen);

#endif
