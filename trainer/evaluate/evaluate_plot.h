// An evaluation as pictures, drawn by gnuplot from files that are left beside them:
//   errors.png      box plots of the errors per group, as in the paper: test, and train beside it
//   trajectory.png  the first trajectory against the truth
//   growth.png      error per snapshot against time: median and quartiles over the trajectories
//   laws.png        total energy and entropy against time; only where they are defined
#ifndef PM_TRAINER_EVALUATE_EVALUATE_PLOT_H
#define PM_TRAINER_EVALUATE_EVALUATE_PLOT_H

#include "evaluate/evaluate.h"

// Makes `folder` if it is missing. `trained`: on trajectories that training saw, or NULL. PM_EFILE:
// cannot write, gnuplot missing or failing; PM_ENOMEM.
pm_status pm_evaluation_plot(const pm_evaluation *evaluation, const pm_evaluation *trained,
                             const char *folder);

#endif
