// Writes a scene as standalone C99: a header and a source that need only a compiler and libm,
// allocate nothing, and step with the same bits as `portmetd run --in-process`.
#ifndef PM_EXPORT_SOURCE_H
#define PM_EXPORT_SOURCE_H

#include "library/setup.h"

// Writes SCENE.c and SCENE.h of a completed setup into `folder`, which it makes if it does not
// exist. PM_ECONFIG: the integrator is no explicit Runge-Kutta method with a fixed number of
// substeps, or a model has so large a product of matrices that BLAS would compute it in an order of
// its own. PM_EFILE: a file cannot be written. PM_ENOMEM.
pm_status pm_export_c(const pm_setup *setup, const char *folder);

// Gives the range in training of a value that the outside prescribes, which several ports may show:
// what all of them were trained on. Returns false if none of them knows it.
bool pm_export_input_range(const pm_setup *setup, int prescribed, double *low, double *high);

#endif
