// The first step of a reduction: modes, their stiffness, and the constants of the basis.
#ifndef PM_TRAINER_MODAL_REDUCE_MODES_H
#define PM_TRAINER_MODAL_REDUCE_MODES_H

#include "modal/reduction.h"

// Finds settings->nmode orthonormal modes by proper orthogonal decomposition of the displacements.
// Fits the flexibility matrix da/d(load) of the body to all trajectories by linear least squares.
// Rotates the modes to the eigenvectors of the flexibility matrix and scales them as basis.h says.
//
// A mode is driven if the root mean square of its modal load is more than a quarter of that of its
// amplitude. At most settings->nstate driven modes become the state, softest first. All other modes
// follow, ordered by the product of these two mean squares, a measure of the work that the loads do
// on them. The caller frees the basis. PM_EDATA (no mode is driven), PM_ENUMERIC, PM_ENOMEM.
pm_status pm_reduce_modes(pm_reduction *r, pm_basis **basis);

#endif
