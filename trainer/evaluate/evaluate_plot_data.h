// The numbers behind the pictures of an evaluation, as columns of text that gnuplot reads.
#ifndef PM_TRAINER_EVALUATE_EVALUATE_PLOT_DATA_H
#define PM_TRAINER_EVALUATE_EVALUATE_PLOT_DATA_H

#include <stdio.h>

#include "evaluate/evaluate.h"

// A file of the folder, opened to write, and closed. PM_EFILE.
pm_status pm_plot_open(FILE **file, const char *folder, const char *name);
pm_status pm_plot_close(FILE *file, const char *folder);

// Columns of a spread over the rollouts: smallest, first quartile, median, third quartile, largest.
enum { PM_PLOT_LOW, PM_PLOT_FIRST, PM_PLOT_MEDIAN, PM_PLOT_THIRD, PM_PLOT_HIGH, PM_PLOT_SPREAD };

// Writes, with errors in per cent and time in s:
//   trajectories.txt  trajectory, 0, error of each group
//   snapshots.txt     trajectory, time, error of each group; a row per state but the first
//   trained_trajectories.txt, trained_snapshots.txt  likewise of those that training saw, if given
//   states.txt        time, true components, predicted components; of the first rollout
//   growth.txt        time, per group the spread of the snapshots' errors
//   laws.txt          time, spread of |E(t) - E(0)| in J, spread of S(t) - S(0) in J/K; not written
//                     where energy is not defined
// PM_EFILE, PM_ENOMEM.
pm_status pm_plot_write_data(const pm_evaluation *evaluation, const pm_evaluation *trained,
                             const char *folder);

#endif
