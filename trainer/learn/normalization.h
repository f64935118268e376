// Fixes what a model carries besides its weights: means and deviations of features, scales of
// operators, lengths of frame vectors, the region of states (training_range.h), all from the states
// of the training data.
#ifndef PM_TRAINER_LEARN_NORMALIZATION_H
#define PM_TRAINER_LEARN_NORMALIZATION_H

#include "learn/samples.h"
#include "scene/system.h"

// Sets the constants of every part and port of the system. Features of co-energies are normalised
// with the weights as they are. `plain`: scales of operators follow the size of states alone, not
// that of rates and energies, so that they depend on units. PM_ENOMEM.
pm_status pm_normalization_of_system(pm_system *system, const pm_samples *samples, bool plain);

#endif
