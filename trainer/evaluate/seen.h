// Tells which trajectories of a dataset were used to train the weights of a system. Weights files
// store a digest of each such trajectory.
#ifndef PM_TRAINER_EVALUATE_SEEN_H
#define PM_TRAINER_EVALUATE_SEEN_H

#include "scene/system.h"

// Sets seen [dataset->ntrajectory] to true for each trajectory on which some weights of the system
// were trained or validated, and to false for all others. Returns the number of such trajectories,
// or -1 if no weights store digests.
int pm_seen_mark(const pm_system *system, const pm_dataset *dataset, bool *seen);

#endif
