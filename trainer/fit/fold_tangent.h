// Folds the tangent of networks marked `zero_at_origin` (model/spec.h) into their skip weights, so
// that evaluating them costs no more than evaluating a network without this mark.
#ifndef PM_TRAINER_FIT_FOLD_TANGENT_H
#define PM_TRAINER_FIT_FOLD_TANGENT_H

#include "base/arena.h"
#include "model/part.h"

// For each marked network in the part's energy and entropy, subtracts the value at zero features
// from the output bias and the gradient there from the linear skip, and removes the mark. The part
// then computes the same function as before. Marked networks must have a skip. The changed specs
// live in the arena. PM_ENOMEM.
pm_status pm_fold_tangent(pm_part *part, pm_arena *arena);

#endif
