// How far reconstructed fields are off: a table, and box plots.
#ifndef PM_TRAINER_MODAL_FIELD_REPORT_H
#define PM_TRAINER_MODAL_FIELD_REPORT_H

#include <stdbool.h>

#include "modal/reconstruct.h"

// Relative L2 errors of some trajectories, and which of them training saw; the caller's memory.
typedef struct pm_field_report {
    int count;
    const double *error; // [count][PM_FIELD_NERROR]
    const bool *trained; // [count]
} pm_field_report;

// Whiskers, quartiles, medians and means, %, of those that training did not see and of those it
// saw; of neither if there are none. PM_ENOMEM.
pm_status pm_field_report_print(const pm_field_report *report);

// errors.png in `folder`, which is made: a box for each quantity, pale what training saw; and the
// script and numbers it was drawn from. PM_EFILE (also without gnuplot), PM_ENOMEM.
pm_status pm_field_report_plot(const pm_field_report *report, const char *folder);

#endif
