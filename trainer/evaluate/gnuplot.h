// Runs gnuplot, which draws all pictures of the trainer.
#ifndef PM_TRAINER_EVALUATE_GNUPLOT_H
#define PM_TRAINER_EVALUATE_GNUPLOT_H

#include "base/status.h"

// Runs gnuplot on the file `script` in `folder`, with this folder as its working directory.
// PM_EFILE: gnuplot is not installed, or it failed.
pm_status pm_gnuplot_run(const char *folder, const char *script);

#endif
