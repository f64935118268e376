// Fixes what a model carries besides its weights: means and deviations of features, scales of
// operators, lengths of frame vectors, the region of states (region.h), all from the states of the
// training data.
#ifndef PM_TRAINER_NORMALISE_H
#define PM_TRAINER_NORMALISE_H

#include "samples.h"
#include "store/system.h"

// Sets the constants of every part and port of the system. Features of co-energies are normalised
// with the weights as they are. PM_ENOMEM.
pm_status pm_normalise_system(pm_system *system, const pm_samples *samples);

#endif
