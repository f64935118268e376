// Reports what the data do not determine: the directions in weight space along which no residual
// changes, from the spectrum of the Gauss-Newton matrix (optimise/normal_equations.h).
#ifndef PM_TRAINER_INFERENCE_SPECTRUM_H
#define PM_TRAINER_INFERENCE_SPECTRUM_H

#include <stdio.h>

#include "loss/objective.h"

// Prints to `out`, evaluated at the present weights on some of the samples: by how much the
// residuals would change if all learned temperatures were 1 % higher, and whether other weights can
// make up for it; which learned reversible couplings of ports the data do not need; and how many
// directions are flat and in which blocks of weights. Says so if there are too many weights for the
// second line, and prints only that if there are too many for the Gauss-Newton matrix. Prints
// nothing if a sample has too many residuals for it. PM_ENOMEM.
pm_status pm_spectrum_report(pm_objective *objective, FILE *out);

#endif
