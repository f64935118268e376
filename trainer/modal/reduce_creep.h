// The second step of a reduction: the times with which the body creeps under a constant load.
#ifndef PM_TRAINER_MODAL_REDUCE_CREEP_H
#define PM_TRAINER_MODAL_REDUCE_CREEP_H

#include "modal/reduction.h"

// Sets the retardation times of a basis whose modes and relaxation times are known, one for each
// branch. A small load on a mode is in balance with
//     load = a - sum_k share_k c_k,     dc_k/dt = (a - c_k)/tau_k.
// The shares of the branches are fitted to the amplitudes of the state by least squares. The
// solution of these equations for a constant load is a sum of exponential functions, whose times
// are the eigenvalues of the symmetric matrix
//     delta_kl tau_k + sqrt(share_k tau_k share_l tau_l) / (1 - sum of all shares).
// Source: Tschoegl, The Phenomenological Theory of Linear Viscoelastic Behavior, Springer 1989,
// chapter 3; the matrix is the inverse of that of the rates, by the formula of Sherman and
// Morrison. A basis without relaxation times has no retardation times. PM_ENUMERIC, PM_ENOMEM.
pm_status pm_reduce_creep(pm_reduction *r, pm_basis *basis);

#endif
