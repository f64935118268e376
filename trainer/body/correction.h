// Fields of a simulation, corrected by what a few better known fields of the same body differ from
// them: that is smooth in the place of the load, even where the fields are not.
//
// The place of a load is the centre of its forces at the last time. Between two known loads that
// differ in x alone, not in the history of their total force, the difference is interpolated
// linearly, beyond the last it stays:
//     z = own + (1 - w) (known_0 - own_0) + w (known_1 - own_1)
// (Two levels of a simulation and the discrepancy between them: Kennedy, O'Hagan, Biometrika 87,
// 2000; here it is interpolated.)
#ifndef PM_TRAINER_BODY_CORRECTION_H
#define PM_TRAINER_BODY_CORRECTION_H

#include "store/field.h"

// All trajectories of `own`, with the nodes, elements and numbering of `known`, of which `count`
// trajectories are used; each of these loads must be among own's, and each of own's loads lie in a
// row with one of these, of the same size and direction. PM_EDATA (they are not; a load is gone at
// the last time; fields of other nodes, variables or times),
// PM_ENOMEM. The caller frees.
pm_status pm_correct(pm_field **corrected, const pm_field *own, const pm_field *known, int count,
                     const int *trajectory);

#endif
