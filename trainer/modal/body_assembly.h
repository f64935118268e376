// An assembly is several bodies that share one basis and are placed in space. The functions find
// the bodies that face each other and project the fields of all bodies to modal coordinates.
#ifndef PM_TRAINER_MODAL_BODY_ASSEMBLY_H
#define PM_TRAINER_MODAL_BODY_ASSEMBLY_H

#include "body/contact_pairs.h"
#include "modal/basis.h"
#include "store/dataset.h"
#include "store/field.h"

// Two bodies that face each other.
typedef struct pm_contact_interface {
    int body[2];            // numbers in the assembly
    pm_contact_pairs pairs; // at least one
} pm_contact_interface;

typedef struct pm_body_assembly {
    pm_arena arena;        // owns everything but the basis
    const pm_basis *basis; // of all bodies
    int nbody;
    pm_placed_body *body; // [nbody]
    int ninterface;
    pm_contact_interface *interface; // [ninterface]
} pm_body_assembly;

// The names of the five quantities of a contact pair, indexed by pm_contact_group.
extern const char *const pm_contact_group_name[PM_CONTACT_GROUPS];

// Reads the names and placements of bodies from the key `beams` of the block `system` in the truth
// file at `path`, and finds the interfaces between the bodies. The caller sets assembly->basis
// first and initialises the rest with zeros; it frees assembly->arena, after a failure too.
// PM_EFILE, PM_ECONFIG, PM_EDATA, PM_ENOMEM.
pm_status pm_body_assembly_load(pm_body_assembly *assembly, const char *path);

// Finds the interfaces between the bodies. Two bodies with a third body between them have none.
// PM_EDATA, PM_ENOMEM.
pm_status pm_body_assembly_find_interfaces(pm_body_assembly *assembly);

// Computes how the quantities of an interface change with the amplitudes of the state of the body
// at one end: matrix [PM_CONTACT_GROUPS npair][nstate], in m/J^0.5 and, for slopes, J^-0.5.
//
// The displacements are linear in the amplitudes. When a section rotates by the angle a, a side at
// the distance h from the axis comes closer to the axis by h/2 a^2, which linear modes cannot
// represent. The opening of a contact pair (body/contact_pairs.h) contains the products u slope_u
// and v slope_v of a sliding displacement and a slope, and a slope is such an angle. The matrix
// therefore adds h/2 slope_u to the quantity u, and h/2 slope_v to v, so that the products contain
// h/2 a^2. PM_ENOMEM.
pm_status pm_contact_interface_matrix(const pm_body_assembly *assembly,
                                      const pm_contact_interface *interface, int end,
                                      double *matrix);

// Checks that the fields of the bodies, field [nbody], have the nodes of the basis and agree in the
// number of trajectories, times and dt. PM_EDATA.
pm_status pm_body_assembly_check(const pm_body_assembly *assembly, const pm_field *const *field);

// Projects the trajectories whose numbers are `trajectory` [count] in the fields of all bodies,
// field [nbody], and writes them as one dataset. For each body it has the columns of
// pm_reduce_project, with the body's name and "_" in front. For each interface between bodies A and
// B it has the state of its part (contact_part.h): A_B_A<i>, A_B_B<i>, A_B_creep<i> and A_B_s.
// Creep and entropy are zero, because the contact of the ground truth neither creeps nor
// dissipates. PM_EDATA (the fields do not fit together), PM_ENOMEM. The caller frees the dataset.
pm_status pm_body_assembly_project(pm_dataset **dataset, const pm_body_assembly *assembly,
                                   const pm_field *const *field, int count, const int *trajectory);

#endif
