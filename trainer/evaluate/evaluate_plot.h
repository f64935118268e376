// Draws an evaluation with gnuplot. The scripts and the numbers stay beside the pictures:
//   errors.png      box plots of the errors of each group; training trajectories beside test ones
//   trajectory.png  the first trajectory and its prediction
//   growth.png      the error of each state over time: median, quartiles and range
//   laws.png        total energy and entropy over time, if they are defined
// The numbers are these files, with errors in per cent and time in s:
//   trajectories.txt  trajectory, 0, error of each group
//   snapshots.txt     trajectory, time, error of each group; one row for each state but the first
//   trained_trajectories.txt, trained_snapshots.txt  the same for `trained`, if it is not NULL
//   states.txt        time, true components, predicted components; of the first rollout
//   growth.txt        time, and for each group the distribution of the errors of states
//   laws.txt          time, distribution of |E(t) - E(0)| in J, distribution of S(t) - S(0) in J/K;
//                     written only if energy is defined
#ifndef PM_TRAINER_EVALUATE_EVALUATE_PLOT_H
#define PM_TRAINER_EVALUATE_EVALUATE_PLOT_H

#include "evaluate/evaluate.h"

// Draws into `folder`, which it creates if it is missing. `trained` is an evaluation on
// trajectories that training used, or NULL. PM_EFILE (cannot write, gnuplot is missing or fails),
// PM_ENOMEM.
pm_status pm_evaluation_plot(const pm_evaluation *evaluation, const pm_evaluation *trained,
                             const char *folder);

#endif
