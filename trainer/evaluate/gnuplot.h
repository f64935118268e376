// Pictures are drawn by gnuplot, from scripts that stay beside them.
#ifndef PM_TRAINER_EVALUATE_GNUPLOT_H
#define PM_TRAINER_EVALUATE_GNUPLOT_H

#include "base/status.h"

// Runs gnuplot inside `folder` on a script there. PM_EFILE: it is not installed, or it failed.
pm_status pm_gnuplot_run(const char *folder, const char *script);

#endif
