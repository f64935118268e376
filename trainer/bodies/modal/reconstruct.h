// Reconstructs the fields of a body from trajectories of its modal state, and compares fields.
#ifndef PM_BODIES_MODAL_RECONSTRUCT_H
#define PM_BODIES_MODAL_RECONSTRUCT_H

#include "bodies/field/field.h"
#include "bodies/modal/basis.h"
#include "bodies/modal/contact_force.h"
#include "store/dataset.h"

// Reconstructs all trajectories of a dataset that has the columns of pm_reduce_project: positions,
// velocities (of the state's modes) and stress (zero if the basis does not know it). The result has
// no forces. The caller frees it.
//   body     NULL: the dataset is about one body. Otherwise the columns of that body of an assembly
//            are read, which begin with its name and "_".
//   contact  NULL: no contact. Otherwise the contact forces of other bodies count as loads.
//   loads    NULL: not known. Otherwise the forces on the nodes in trajectory[i] of this field
//            belong to trajectory i, and their stress close to where they act is added.
// Modal loads without a column are taken as zero. PM_EDATA (another column is missing, or the loads
// do not fit), PM_ENOMEM.
pm_status pm_reconstruct(pm_field **field, const pm_basis *basis, const pm_dataset *modes,
                         const char *body, const pm_contact_force *contact, const pm_field *loads,
                         const int *trajectory);

// The quantities that are compared: displacements, velocities, and stresses on free nodes.
typedef enum pm_field_error {
    PM_ERROR_DISPLACEMENT,
    PM_ERROR_VELOCITY,
    PM_ERROR_STRESS
} pm_field_error;
#define PM_FIELD_NERROR 3

// Computes the relative L2 errors of trajectory i of `predicted` against trajectory[i] of `truth`,
// error [predicted->ntrajectory][PM_FIELD_NERROR]. A node is free if it moves in the truth. A
// quantity that is zero throughout the truth has the error 0 if it is predicted to be zero, and
// infinity otherwise. PM_EDATA (the fields do not fit together).
pm_status pm_field_errors(const pm_field *predicted, const pm_field *truth, const int *trajectory,
                          double *error);

#endif
