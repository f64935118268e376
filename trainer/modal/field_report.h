// Reports the errors of reconstructed fields as a table and as box plots.
#ifndef PM_TRAINER_MODAL_FIELD_REPORT_H
#define PM_TRAINER_MODAL_FIELD_REPORT_H

#include <stdbool.h>

#include "modal/reconstruct.h"

// The relative L2 errors of some trajectories. The caller owns the arrays.
typedef struct pm_field_report {
    int count;
    const double *error; // [count][PM_FIELD_NERROR]
    const bool *trained; // [count] whether training saw the trajectory
} pm_field_report;

// Prints whiskers, quartiles, medians and means, in %, first for the trajectories that training did
// not see, then for those it saw; a group without trajectories is left out. PM_ENOMEM.
pm_status pm_field_report_print(const pm_field_report *report);

// Makes `folder`, if it does not exist, and draws errors.png in it with gnuplot. Each quantity has
// a box for the trajectories that training did not see, and a pale box for those that it saw. A
// group without trajectories has no boxes. The script errors.gp and the numbers, in test.txt and
// trained.txt, stay in the folder. PM_EFILE (a file cannot be written, or gnuplot is missing or
// fails), PM_ENOMEM.
pm_status pm_field_report_plot(const pm_field_report *report, const char *folder);

#endif
