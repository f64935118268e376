// The openings of the pairs of a contact interface, computed from a row of the dataset that
// pm_body_assembly_project writes.
#ifndef PM_TRAINER_MODAL_CONTACT_OPENINGS_H
#define PM_TRAINER_MODAL_CONTACT_OPENINGS_H

#include "modal/body_assembly.h"

typedef struct pm_contact_openings {
    const pm_contact_interface *interface;
    int nstate;
    int travel[2], creep; // first columns of these groups
    double *matrix[2];    // [PM_CONTACT_GROUPS npair][nstate], of pm_contact_interface_matrix
    double *value;        // [PM_CONTACT_GROUPS][npair], of the last row
} pm_contact_openings;

// Finds the columns of an interface in a dataset. Memory from the arena. PM_EDATA (columns are
// missing), PM_ENOMEM.
pm_status pm_contact_openings_open(pm_contact_openings *openings, const pm_body_assembly *assembly,
                                   const pm_contact_interface *interface, const pm_dataset *modes,
                                   pm_arena *arena);

// Computes the five quantities of all pairs, [PM_CONTACT_GROUPS][npair], from `row`, one row of the
// dataset given to open. Creep is included in g. The result is valid until the next call.
const double *pm_contact_openings_compute(const pm_contact_openings *openings, const double *row);

#endif
