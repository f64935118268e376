// What the data do not decide: directions of the weights along which no residual changes, by the
// spectrum of the Gauss-Newton matrix.
#ifndef PM_TRAINER_LEARN_SPECTRUM_H
#define PM_TRAINER_LEARN_SPECTRUM_H

#include <stdio.h>

#include "learn/objective.h"

// At the present weights, on a sample of the data: how many directions are flat, which blocks of
// weights they are made of, and by how much the residuals change if all learned temperatures were
// higher by one per cent. Says nothing for more weights than a matrix is affordable of. PM_ENOMEM.
pm_status pm_spectrum_report(pm_objective *objective, FILE *out);

#endif
