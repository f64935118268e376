// The third step of a reduction: the remainder of the displacements, the stress, and the stress
// close to the loads, as functions of the features of a state.
#ifndef PM_TRAINER_MODAL_REDUCE_PATTERNS_H
#define PM_TRAINER_MODAL_REDUCE_PATTERNS_H

#include "modal/reduction.h"

// Fits the remaining parts of a basis whose modes are known (pm_reduce_modes):
//     basis->displacement  the pattern of the remainder, which is linear in the features of a state
//     basis->stress        the pattern of the stress, if the field has stresses
//     basis->local         the kernel of the stress close to the loads (local.h), if the field has
//                          stresses and settings->reach > 0
// The stress is the sum of the stress pattern and the convolution with the kernel. The pattern is
// fitted first. Then, in each of four rounds, the kernel is fitted to the stress less the pattern,
// and the pattern to the stress less the convolution. All results are rounded to single precision.
// PM_EDATA (the body is not prismatic and so has no kernel), PM_ENUMERIC, PM_ENOMEM.
pm_status pm_reduce_patterns(pm_reduction *r, pm_basis *basis);

#endif
