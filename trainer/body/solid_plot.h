// Draws the errors of a learned body over trajectories.
#ifndef PM_TRAINER_BODY_SOLID_PLOT_H
#define PM_TRAINER_BODY_SOLID_PLOT_H

#include "body/solid_response.h"

// Makes `folder`, if it does not exist, and draws errors.png in it with gnuplot: a box for each of
// the first `nscore` errors, in %, over response [count]. The numbers, errors.txt with a row for
// each trajectory, and the script stay beside it. PM_EFILE: a file cannot be written, or gnuplot is
// missing or fails.
pm_status pm_solid_plot(int nscore, int count, const pm_solid_response *response,
                        const char *folder);

#endif
