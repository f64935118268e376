// Relative errors of a predicted trajectory against a true one, in the columns of the dataset. Each
// group of columns has its own score; groups of the same name in several subsystems share one.
#ifndef PM_SIM_SCORE_H
#define PM_SIM_SCORE_H

#include "scene/columns.h"

// Computes the relative L2 error ||predicted - truth|| / ||truth|| of each group, over the whole
// trajectory and for each snapshot. predicted, truth: [ntime][ncolumn]; trajectory: [ngroup];
// snapshot: [ntime][ngroup] or NULL. A group that is zero throughout the truth scores the absolute
// norm. If the true norm of a group in a snapshot is less than 1e-9 of its root mean square over
// the trajectory, the error of this snapshot is divided by that root mean square instead.
void pm_score(const pm_columns *columns, int ntime, int ncolumn, const double *predicted,
              const double *truth, double *trajectory, double *snapshot);

// The sums with which the score of one group is computed snapshot by snapshot. They start at zero.
// pm_score_add adds one snapshot; predicted, truth: [ncolumn]. pm_score_of returns the relative
// error of all snapshots so far.
typedef struct pm_score_sums {
    double error; // of (predicted - truth)^2
    double norm;  // of truth^2
} pm_score_sums;
void pm_score_add(const pm_columns *columns, int group, const double *predicted,
                  const double *truth, pm_score_sums *sums);
double pm_score_of(const pm_score_sums *sums);

// The numbers of a box plot. The whiskers `low` and `high` are the extreme values within 1.5
// interquartile ranges of the box.
typedef struct pm_box {
    double low, first_quartile, median, third_quartile, high, mean, largest;
} pm_box;
// Computes the numbers of a box plot for n > 0 values, with quartiles by linear interpolation.
// Sorts the values in place. NaN, the score of a failed rollout, counts as the largest.
pm_box pm_box_of(int n, double *value);

#endif
