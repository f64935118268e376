// Errors of a predicted trajectory against a true one, in the dataset's own columns, per group of
// columns (groups of the same name in several subsystems are pooled).
#ifndef PM_SIM_SCORE_H
#define PM_SIM_SCORE_H

#include "scene/columns.h"

// Relative L2 error of each group over a whole trajectory, ||predicted - true|| / ||true||, and of
// each snapshot. predicted, truth: [ntime][ncolumn]; trajectory: [ngroup]; snapshot:
// [ntime][ngroup] or NULL. A group that is identically zero in truth scores the absolute norm; one
// that is zero, or 1e-9 of that, in a snapshot alone is measured by its root mean square over the
// trajectory.
void pm_score(const pm_columns *columns, int ntime, int ncolumn, const double *predicted,
              const double *truth, double *trajectory, double *snapshot);

// The same snapshot by snapshot: the sums of one group, which begin at zero. predicted, truth:
// [ncolumn].
typedef struct pm_score_sums {
    double error, norm; // of the squares of predicted - true, and of true
} pm_score_sums;
void pm_score_add(const pm_columns *columns, int group, const double *predicted,
                  const double *truth, pm_score_sums *sums);
double pm_score_of(const pm_score_sums *sums);

// Whiskers, quartiles and median of n > 0 values, by linear interpolation; sorts them in place, NaN
// last. Whiskers are the furthest values within 1.5 interquartile ranges of the box.
typedef struct pm_box {
    double low, first_quartile, median, third_quartile, high, mean;
} pm_box;
pm_box pm_box_of(int n, double *value);

#endif
