// Contact forces of an assembly, computed from the state of its interfaces: the nodal forces on one
// body, and the error of the total force against the ground truth. An opening x gives the force
// -stiffness min(x, 0).
#ifndef PM_TRAINER_MODAL_CONTACT_FORCE_H
#define PM_TRAINER_MODAL_CONTACT_FORCE_H

#include "modal/contact_openings.h"

// The contact forces on one body.
typedef struct pm_contact_force {
    const pm_body_assembly *assembly;
    int body;
    const double *stiffness;       // [ninterface] N/m, of a pair of each interface
    pm_contact_openings *openings; // [ninterface], set for the interfaces of the body
    double *effort;                // work space
} pm_contact_force;

// Finds the columns of the body's interfaces in a dataset that pm_body_assembly_project writes.
// `stiffness` [ninterface], N/m, must outlive the result. Memory from the arena. PM_EDATA,
// PM_ENOMEM.
pm_status pm_contact_force_open(pm_contact_force *force, const pm_body_assembly *assembly, int body,
                                const pm_dataset *modes, const double *stiffness, pm_arena *arena);

// Adds the contact forces in the state `row`, one row of the dataset given to open, to f
// [nnode][3], N, in the body's own frame.
void pm_contact_force_add(const pm_contact_force *force, const double *row, double *f);

// Computes the relative L2 error over each trajectory of the total normal force of an interface,
// error [modes->ntrajectory]; NAN where the bodies never touch. The reference is the total contact
// force in the true field of one of the two bodies, which must have no other interface. field
// [nbody] holds the fields of all bodies, and trajectory [modes->ntrajectory] the numbers of their
// trajectories. PM_EDATA (columns, states or fields do not fit together, there are no contact
// forces, or both bodies have other interfaces), PM_ENOMEM.
pm_status pm_contact_force_errors(const pm_body_assembly *assembly,
                                  const pm_contact_interface *interface, const pm_dataset *modes,
                                  double stiffness, const pm_field *const *field,
                                  const int *trajectory, double *error);

#endif
