// Draws an evaluation with gnuplot. The scripts and the numbers stay beside the pictures:
//   errors.png      box plots of the errors of each group; training trajectories beside test ones
//   trajectory.png  the first trajectory and its prediction
//   growth.png      the error of each state over time: median, quartiles and range
//   laws.png        total energy and entropy over time, if they are defined
#ifndef PM_TRAINER_EVALUATE_EVALUATE_PLOT_H
#define PM_TRAINER_EVALUATE_EVALUATE_PLOT_H

#include <stdio.h>

#include "evaluate/evaluate.h"

// Draws into `folder`, which it creates if it is missing. `trained` is an evaluation on
// trajectories that training used, or NULL. PM_EFILE (cannot write, gnuplot is missing or fails),
// PM_ENOMEM.
pm_status pm_evaluation_plot(const pm_evaluation *evaluation, const pm_evaluation *trained,
                             const char *folder);

// Opens the gnuplot script NAME.gp in `folder`, which draws NAME.png with the given size in pixels
// in the style of all pictures of the trainer. pm_plot_close (evaluate/evaluate_plot_data.h) closes
// it. PM_EFILE.
pm_status pm_plot_open_script(FILE **file, const char *folder, const char *name, int width,
                              int height);
// Returns colour number i of those that pictures use in turn, as gnuplot writes it.
const char *pm_plot_colour(int i);

#endif
