// Computes the constants of a model that are not weights: means and deviations of features, scales
// of operators, lengths of `along` vectors, and the ranges of the training states and of boundary
// inputs (model/training_range.h). All are statistics of the training data.
#ifndef PM_TRAINER_FIT_NORMALIZATION_H
#define PM_TRAINER_FIT_NORMALIZATION_H

#include "data/samples.h"
#include "scene/system.h"

// Sets these constants in the models of all subsystems and ports of the system. The samples must be
// windows of one step. Features that contain co-energies are evaluated with the present weights.
// With `plain` the scales of operators follow the size of states alone; otherwise they also follow
// the size of rates and energies (data/magnitudes.h), so that training does not depend on units.
// PM_ECONFIG (too many networks), PM_ENOMEM.
pm_status pm_normalization_of_system(pm_system *system, const pm_samples *samples, bool plain);

// Computes the constants of those features of strengths anew that contain co-energies, which the
// present weights give. The model stays the same only while the outputs of these networks are zero,
// as they are until the initial weights have been chosen. `samples` as above, or those of the
// derivative residual.
pm_status pm_normalization_of_strengths(pm_system *system, const pm_samples *samples);

#endif
