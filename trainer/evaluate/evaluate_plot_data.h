// Writes the numbers behind the pictures of an evaluation as text columns, which gnuplot reads.
#ifndef PM_TRAINER_EVALUATE_EVALUATE_PLOT_DATA_H
#define PM_TRAINER_EVALUATE_EVALUATE_PLOT_DATA_H

#include <stdio.h>

#include "evaluate/evaluate.h"

// Opens the file `name` in `folder` for writing. PM_EFILE.
pm_status pm_plot_open(FILE **file, const char *folder, const char *name);
// Closes a file that pm_plot_open opened; `folder` names it in the error. PM_EFILE: a write failed.
pm_status pm_plot_close(FILE *file, const char *folder);

// The columns that describe a distribution over the rollouts.
enum {
    PM_PLOT_LOW,    // smallest
    PM_PLOT_FIRST,  // first quartile
    PM_PLOT_MEDIAN, // median
    PM_PLOT_THIRD,  // third quartile
    PM_PLOT_HIGH,   // largest
    PM_PLOT_SPREAD  // the number of these columns
};

// Writes these files, with errors in per cent and time in s:
//   trajectories.txt  trajectory, 0, error of each group
//   snapshots.txt     trajectory, time, error of each group; one row for each state but the first
//   trained_trajectories.txt, trained_snapshots.txt  the same for `trained`, if it is not NULL
//   states.txt        time, true components, predicted components; of the first rollout
//   growth.txt        time, and for each group the distribution of the errors of states
//   laws.txt          time, distribution of |E(t) - E(0)| in J, distribution of S(t) - S(0) in J/K;
//                     written only if energy is defined
// PM_EFILE, PM_ENOMEM.
pm_status pm_plot_write_data(const pm_evaluation *evaluation, const pm_evaluation *trained,
                             const char *folder);

#endif
