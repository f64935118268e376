// Fits a basis (basis.h) to fields, and writes fields as trajectories of its state.
#ifndef PM_TRAINER_MODAL_REDUCE_H
#define PM_TRAINER_MODAL_REDUCE_H

#include "modal/basis.h"
#include "modal/modal_trajectory.h"
#include "store/dataset.h"
#include "store/field.h"

typedef struct pm_reduce_how {
    int nmode;                         // modes in all, at most PM_BASIS_MAX_MODES
    int nstate;                        // at most so many carry the energy
    int nlead;                         // at most so many of these in products
    int nbranch;                       // at most PM_BASIS_MAX_BRANCHES
    double tau[PM_BASIS_MAX_BRANCHES]; // s
    double inertia_time;               // s
    double temperature;                // K
    int displacement_rank, stress_rank;
    int reach;   // sections over which the stress close to a load is learned; 0: not at all
    bool square; // learn from the eight symmetric copies (symmetry_copies.h)
} pm_reduce_how;

// From `count` trajectories of the field; forces of contact are loads like any. PM_EDATA,
// PM_ENUMERIC, PM_ENOMEM.
pm_status pm_reduce_fit(pm_basis **basis, const pm_field *field, int count, const int *trajectory,
                        const pm_reduce_how *how);

// `count` trajectories, with their symmetric copies one after the other if asked for, as a
// dataset with columns a<i>, p<i>, c<k>_<i> of the state, entropy s, loads f<i> of the state's
// modes and h<j> of the others, and with rates. PM_EDATA, PM_ENOMEM.
pm_status pm_reduce_project(pm_dataset **dataset, const pm_basis *basis, const pm_field *field,
                            int count, const int *trajectory, bool square,
                            pm_boundary_inputs loads);

#endif
