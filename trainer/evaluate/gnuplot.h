// Pictures of the trainer: files of numbers, gnuplot scripts that draw them, and gnuplot itself.
#ifndef PM_TRAINER_EVALUATE_GNUPLOT_H
#define PM_TRAINER_EVALUATE_GNUPLOT_H

#include <stdio.h>

#include "base/status.h"

// Makes a folder for pictures, if it is missing, in one that exists. PM_EFILE.
pm_status pm_plot_folder(const char *folder);
// Opens the file `name` in `folder` for writing. PM_EFILE.
pm_status pm_plot_open(FILE **file, const char *folder, const char *name);
// Opens the gnuplot script NAME.gp in `folder`, which draws NAME.png with the given size in pixels
// in the style of all pictures of the trainer. PM_EFILE.
pm_status pm_plot_open_script(FILE **file, const char *folder, const char *name, int width,
                              int height);
// Closes a file that one of them opened; `folder` names it in the error. PM_EFILE: a write failed.
pm_status pm_plot_close(FILE *file, const char *folder);
// Returns colour number i of those that pictures use in turn, as gnuplot writes it.
const char *pm_plot_colour(int i);

// Runs gnuplot on the file `script` in `folder`, with this folder as its working directory.
// PM_EFILE: gnuplot is not installed, or it failed.
pm_status pm_gnuplot_run(const char *folder, const char *script);

#endif
