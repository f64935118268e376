// Contact forces of an assembly, computed from the state of its interfaces: the nodal forces on one
// body, and the error of the total force against the ground truth. A pair with the opening x
// (bodies/solid/contact_pairs.h) exerts the force -stiffness min(x, 0) along its normal.
#ifndef PM_BODIES_MODAL_CONTACT_FORCE_H
#define PM_BODIES_MODAL_CONTACT_FORCE_H

#include "bodies/modal/body_assembly.h"

// The openings of the pairs of an interface. The opening of a pair is g + u slope_u + v slope_v,
// with the five quantities of bodies/solid/contact_pairs.h; here g, the distance of the pair along
// the normal, includes the creep.
typedef struct pm_contact_openings {
    const pm_contact_interface *interface; // borrowed
    int size[2];                           // coordinates of each body
    // First columns of the groups A and B [size], and of the group creep [npair], m, of
    // contact_part.h.
    int travel[2], creep;
    double *matrix[2]; // [PM_CONTACT_GROUPS npair][size], of pm_contact_interface_matrix
    double *value;     // [PM_CONTACT_GROUPS][npair], of the last row
} pm_contact_openings;

// Finds the columns of an interface in `modes`, a dataset with the columns that
// pm_body_assembly_project writes, and computes the matrices of the interface. `interface` must
// outlive the result; `modes` need not. The arrays lie in the arena. PM_EDATA (columns are
// missing), PM_ENOMEM.
pm_status pm_contact_openings_open(pm_contact_openings *openings, const pm_body_assembly *assembly,
                                   const pm_contact_interface *interface, const pm_dataset *modes,
                                   pm_arena *arena);

// Computes the five quantities of all pairs from `row`, one row of a dataset with the columns of
// the one given to pm_contact_openings_open. Returns [PM_CONTACT_GROUPS][npair] in the order of
// pm_contact_group: g with the creep added, u and v, in m, then slope_u and slope_v, which have no
// unit. The array belongs to `openings` and is valid until the next call.
const double *pm_contact_openings_compute(const pm_contact_openings *openings, const double *row);

// The contact forces on one body.
typedef struct pm_contact_force {
    const pm_body_assembly *assembly;
    int body;
    const double *stiffness;       // [ninterface] N/m, of one pair of each interface; borrowed
    pm_contact_openings *openings; // [ninterface], set only for the interfaces of the body
    double *effort;                // work space
} pm_contact_force;

// Finds the columns of the interfaces of body number `body` in `modes`, a dataset with the columns
// that pm_body_assembly_project writes. `assembly` and `stiffness` [ninterface], N/m, must outlive
// the result; `modes` need not. The arrays lie in the arena. PM_EDATA (columns are missing),
// PM_ENOMEM.
pm_status pm_contact_force_open(pm_contact_force *force, const pm_body_assembly *assembly, int body,
                                const pm_dataset *modes, const double *stiffness, pm_arena *arena);

// Adds the contact forces on the nodes of the body to f [nnode][3], N, in the body's own frame.
// `row` is the state: one row of a dataset with the columns of the dataset given to
// pm_contact_force_open.
void pm_contact_force_add(const pm_contact_force *force, const double *row, double *f);

// Compares the total normal force of an interface, computed from the states in `modes`, with the
// true one. The true force is the total contact force in the field of one of the two bodies, which
// must have no other interface. field [nbody] holds the true fields of all bodies.
// trajectory [modes->ntrajectory]: trajectory[i] is the number of the trajectory of the fields that
// corresponds to trajectory i of `modes`. `stiffness` is that of one pair of the interface, N/m.
// Writes error [modes->ntrajectory], the relative L2 error of the force over each trajectory, or
// NAN if the bodies never touch in the true trajectory. PM_EDATA (columns are missing, the fields
// do not fit together or have another number of times than `modes`, or neither body has contact
// forces and no other interface), PM_ENOMEM.
pm_status pm_contact_force_errors(const pm_body_assembly *assembly,
                                  const pm_contact_interface *interface, const pm_dataset *modes,
                                  double stiffness, const pm_field *const *field,
                                  const int *trajectory, double *error);

#endif
