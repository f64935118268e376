// An evaluation as pictures, as in the paper: box plots of the errors per group and one trajectory
// against the truth. Drawn by gnuplot from files that are left beside the pictures.
#ifndef PM_TRAINER_EVALUATE_PLOT_H
#define PM_TRAINER_EVALUATE_PLOT_H

#include "evaluate.h"

// Makes `folder` if it is missing and writes errors.png and trajectory.png with their data and
// scripts. PM_EFILE: cannot write, gnuplot missing or failing.
pm_status pm_evaluation_plot(const pm_evaluation *evaluation, const char *folder);

#endif
