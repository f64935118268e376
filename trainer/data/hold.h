// The samples of a column show what it is between them: a smooth curve, a staircase that a
// controller or a logger holds, or what a straight line joins best.
#ifndef PM_TRAINER_DATA_HOLD_H
#define PM_TRAINER_DATA_HOLD_H

#include "scene/scene.h"
#include "store/dataset.h"

// Finds how a column should be held between its samples, over all trajectories. It is
// PM_HOLD_SMOOTH if a polynomial through neighbours predicts samples much better than a straight
// line does, or if it never changes. Where a line predicts badly, samples either jump
// (PM_HOLD_PREVIOUS: changes are large, or few among samples that hardly change) or are noisy
// (PM_HOLD_LINEAR). All else is PM_HOLD_LINEAR. PM_ENOMEM.
pm_status pm_hold_of_column(const pm_dataset *dataset, int column, pm_hold *hold);

#endif
