// The openings of the pairs of a contact interface, computed from a row of the dataset that
// pm_body_assembly_project writes. The opening of a pair is g + u slope_u + v slope_v, with the
// five quantities of body/contact_pairs.h; here g, the distance of the pair along the normal,
// includes the creep.
#ifndef PM_TRAINER_MODAL_CONTACT_OPENINGS_H
#define PM_TRAINER_MODAL_CONTACT_OPENINGS_H

#include "modal/body_assembly.h"

// The caller owns this storage; its arrays lie in the arena given to pm_contact_openings_open.
typedef struct pm_contact_openings {
    const pm_contact_interface *interface; // borrowed
    int size[2];                           // coordinates of each body
    // First columns of the groups A and B [size], and of the group creep [npair], m, of
    // contact_part.h.
    int travel[2], creep;
    double *matrix[2]; // [PM_CONTACT_GROUPS npair][size], of pm_contact_interface_matrix
    double *value;     // [PM_CONTACT_GROUPS][npair], of the last row
} pm_contact_openings;

// Finds the columns of an interface in `modes`, and computes the matrices of the interface.
// `interface` must outlive the result; `modes` need not. The arrays lie in the arena. PM_EDATA
// (columns are missing), PM_ENOMEM.
pm_status pm_contact_openings_open(pm_contact_openings *openings, const pm_body_assembly *assembly,
                                   const pm_contact_interface *interface, const pm_dataset *modes,
                                   pm_arena *arena);

// Computes the five quantities of all pairs from `row`, one row of a dataset with the columns of
// the one given to pm_contact_openings_open. Returns [PM_CONTACT_GROUPS][npair] in the order of
// pm_contact_group: g with the creep added, u and v, in m, then slope_u and slope_v, which have no
// unit. The array belongs to `openings` and is valid until the next call.
const double *pm_contact_openings_compute(const pm_contact_openings *openings, const double *row);

#endif
