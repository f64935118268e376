// The second step of a reduction: the remainder of the displacements, the stress, and the stress
// close to the loads, as functions of the features of a state.
#ifndef PM_TRAINER_MODAL_REDUCE_PATTERNS_H
#define PM_TRAINER_MODAL_REDUCE_PATTERNS_H

#include "modal/reduction.h"

// Fits the patterns and the local kernel of a basis that has its modes. Stress pattern and kernel
// are fitted in turn, each to what the other leaves. Everything is rounded to single precision.
// PM_EDATA (the body is not prismatic), PM_ENUMERIC, PM_ENOMEM.
pm_status pm_reduce_patterns(pm_reduction *r, pm_basis *basis);

#endif
