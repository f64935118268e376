// The region of states that a part's weights were trained on: for each group of variables the range
// of its length, or of the value itself where it has one component, so that a rotation leads
// nowhere. Kept among the part's constants as "training_range.low" and "training_range.high"
// [1][ngroup]; weights that lack them have no region, and nothing leaves it.
#ifndef PM_MODEL_TRAINING_RANGE_H
#define PM_MODEL_TRAINING_RANGE_H

#include "model/part.h"

// Gives the part an empty region, to be widened. PM_ENOMEM.
pm_status pm_training_range_declare(pm_part *part);
// Widens it to hold the state z [nz].
void pm_training_range_widen(pm_part *part, const double *z);

// Where the part's region is kept, to be found once.
typedef struct pm_training_range {
    const pm_layout *layout;
    const double *low, *high; // [layout->ngroup]; NULL: it has none
} pm_training_range;
pm_training_range pm_training_range_of(const pm_part *part); // valid as long as the part

// The group that is furthest outside.
typedef struct pm_departure {
    const pm_group *group; // NULL: none is outside
    double value, low, high;
    double widths; // by how much it is outside, in widths of its range
} pm_departure;
pm_departure pm_training_range_departure(pm_training_range region, const double *z);

#endif
