// Which trajectories of a dataset the weights of a system know from their training.
#ifndef PM_TRAINER_EVALUATE_SEEN_H
#define PM_TRAINER_EVALUATE_SEEN_H

#include "scene/system.h"

// Marks those on which some weights of the system were trained, or by which they were chosen
// (validation): seen [dataset->ntrajectory], all written. Returns how many there are; -1 if no
// weights remember what they were trained on.
int pm_seen_mark(const pm_system *system, const pm_dataset *dataset, bool *seen);

#endif
