// Draws predictions from estimated starts with their bands of 90 %, beside what was measured. The
// scripts and the numbers stay beside the pictures:
//   prediction_N.png  trajectory N: on the left each measured column and its prediction, on the
//                     right measurement minus prediction
//   coverage.png      the share of all measurements inside the bands, against the time
#ifndef PM_TRAINER_COMMAND_EVALUATE_BANDS_H
#define PM_TRAINER_COMMAND_EVALUATE_BANDS_H

#include "learn/estimate.h"

#define PM_NINETY_PER_CENT 1.6448536269514722 // deviations of a normal distribution

// Draws the first four trajectories into `folder`, which it creates if it is missing. The arguments
// are those of pm_estimate_make; `seconds` is how long the starts were estimated. Bands and
// coverage are left out if the estimate has no deviations. PM_EFILE: cannot write, or gnuplot is
// missing or fails.
pm_status pm_evaluate_bands_draw(const pm_estimate *estimate, const pm_observation *observation,
                                 const pm_dataset *data, const int *which, double seconds,
                                 const char *folder);

#endif
