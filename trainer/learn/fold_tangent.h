// Networks at rest (spec.h) as what they are without that word: as fast as any.
#ifndef PM_TRAINER_LEARN_FOLD_TANGENT_H
#define PM_TRAINER_LEARN_FOLD_TANGENT_H

#include "model/part.h"

// Takes the tangent at features of 0 from the linear form and the bias of each network at rest in
// the part's energy and entropy, which is the same function then, no longer marked; they must have
// a skip. Specs are made in the arena. PM_ENOMEM.
pm_status pm_fold_tangent(pm_part *part, pm_arena *arena);

#endif
