// From trajectories of a basis's state back to the fields of the body.
#ifndef PM_TRAINER_MODAL_RECONSTRUCT_H
#define PM_TRAINER_MODAL_RECONSTRUCT_H

#include "modal/basis.h"
#include "modal/body_assembly.h"
#include "store/dataset.h"
#include "store/field.h"

// All trajectories of a dataset with the columns that pm_reduce_project writes: positions,
// velocities of the state's modes, stress (zero if the basis does not know it), loads left out.
// What loads do to the stress close to them is added where their forces on the nodes are known:
// `loads`, trajectory which[i] for trajectory i; may be NULL. `body` NULL: of the one
// body there is; else of that one, whose columns begin with its name and "_". `touch`: what other
// bodies press on it counts as loads do; NULL: nothing. Loads that have no columns are taken as
// none. PM_EDATA (another column is missing), PM_ENOMEM. The caller frees.
pm_status pm_reconstruct(pm_field **field, const pm_basis *basis, const pm_dataset *modes,
                         const char *body, const pm_contact_force *touch, const pm_field *loads,
                         const int *which);

// What is compared: displacements, velocities, stresses on free nodes.
typedef enum pm_field_error {
    PM_ERROR_DISPLACEMENT,
    PM_ERROR_VELOCITY,
    PM_ERROR_STRESS
} pm_field_error;
#define PM_FIELD_NERROR 3

// Relative L2 errors over trajectory i of `predicted` against trajectory[i] of `truth`,
// error [predicted->ntrajectory][PM_FIELD_NERROR]. A node is free if it moves in the truth. A
// quantity that is zero throughout scores 0 if it is so in both, else infinity. PM_EDATA if the
// fields do not fit.
pm_status pm_field_errors(const pm_field *predicted, const pm_field *truth, const int *trajectory,
                          double *error);

#endif
