// Pictures of an evaluation, which the Python package draws with gnuplot
// (daemon/python/portmet/pictures). The scripts and the numbers stay beside the pictures:
//   errors.png      box plots of the errors of each group; training trajectories beside test ones
//   trajectory.png  the first trajectory and its prediction
//   growth.png      the error of each state over time: median and quartiles
//   laws.png        total energy and entropy over time, if they are defined
// The numbers of the evaluation are these tables, with errors in per cent and time in s, below a
// line with the mark PM_FILES_PICTURE:
//   trajectories.txt  trajectory, time, error of each group, total energy in J and entropy in J/K
//   at
//                     the start
//   snapshots.txt     likewise for each state but the first; an energy that is not defined is nan
//   trained_trajectories.txt, trained_snapshots.txt  the same for `trained`, if it is not NULL
//   states.txt        time, true components, predicted components; of the first rollout
#ifndef PM_TRAINER_EVALUATE_EVALUATE_PLOT_H
#define PM_TRAINER_EVALUATE_EVALUATE_PLOT_H

#include "evaluate/evaluate.h"

// Draws into `folder`, which it creates if it is missing. `trained` is an evaluation on
// trajectories that training used, or NULL. PM_EFILE (cannot write, a file is of no picture,
// gnuplot is missing or fails); PM_EUSAGE: the program reads a table that it would write.
pm_status pm_evaluation_plot(const pm_evaluation *evaluation, const pm_evaluation *trained,
                             const char *folder);

#endif
