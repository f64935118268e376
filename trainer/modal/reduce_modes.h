// The first step of a reduction: modes, their stiffness, and the constants of the basis.
#ifndef PM_TRAINER_MODAL_REDUCE_MODES_H
#define PM_TRAINER_MODAL_REDUCE_MODES_H

#include "modal/reduction.h"

// Finds as many orthonormal modes as asked for by proper orthogonal decomposition of the
// displacements, fits the flexibility da/d(load) of the material to all trajectories by linear
// least squares, and rotates the modes to its eigenvectors. Modes that the loads hold in
// equilibrium become the state, softest first; modes that merely accompany others follow, ordered
// by the work that the loads do on them. PM_EDATA (no mode follows the loads), PM_ENUMERIC,
// PM_ENOMEM. The caller frees the basis.
pm_status pm_reduce_modes(pm_reduction *r, pm_basis **basis);

#endif
