// Fits a basis (basis.h) to the fields of a body, and writes fields as trajectories of its state.
#ifndef PM_TRAINER_MODAL_REDUCE_H
#define PM_TRAINER_MODAL_REDUCE_H

#include "modal/basis.h"
#include "modal/reduction.h"
#include "store/dataset.h"
#include "store/field.h"

// Fits a basis to some trajectories of the field; `trajectory` [count] has their numbers. Forces of
// contact count as loads. PM_EDATA, PM_ENUMERIC, PM_ENOMEM. The caller frees the basis.
pm_status pm_reduce_fit(pm_basis **basis, const pm_field *field, int count, const int *trajectory,
                        const pm_reduce_settings *settings);

// Projects the trajectories whose numbers are `trajectory` [count] to the modes, and writes them as
// a dataset with rates. Its columns are a<i>, p<i> and c<k>_<i> of the state, the entropy s, and
// the loads f<i> of the state's modes and h<j> of the other modes. With `square` the eight
// symmetric copies of each trajectory follow one another. PM_EDATA, PM_ENOMEM. The caller frees the
// dataset.
pm_status pm_reduce_project(pm_dataset **dataset, const pm_basis *basis, const pm_field *field,
                            int count, const int *trajectory, bool square, pm_load_kind loads);

#endif
