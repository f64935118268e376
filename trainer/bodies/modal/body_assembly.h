// An assembly is several bodies that are placed in space. Each body is described either by modes or
// as a solid. All bodies in modes share one basis; the coordinates of a solid are the displacements
// of its nodes. The functions find the bodies that face each other and convert the fields of all
// bodies to their coordinates.
#ifndef PM_BODIES_MODAL_BODY_ASSEMBLY_H
#define PM_BODIES_MODAL_BODY_ASSEMBLY_H

#include <stdbool.h>

#include "bodies/field/field.h"
#include "bodies/modal/basis.h"
#include "bodies/solid/contact_pairs.h"
#include "store/dataset.h"

// Two bodies that face each other.
typedef struct pm_contact_interface {
    int body[2];            // numbers in the assembly
    pm_contact_pairs pairs; // at least one
} pm_contact_interface;

// A body that is a solid.
typedef struct pm_assembled_solid {
    const pm_field *field; // borrowed; NULL: the body is in modes
    // [ncontact] the nodes on which contact acts, in ascending order.
    int ncontact, *contact;
} pm_assembled_solid;

typedef struct pm_body_assembly {
    pm_arena arena;        // owns everything but basis and fields
    const pm_basis *basis; // of all bodies in modes; NULL: there is none
    int nbody;
    pm_placed_body *body;      // [nbody]
    pm_assembled_solid *solid; // [nbody]; NULL: all bodies are in modes
    int ninterface;
    pm_contact_interface *interface; // [ninterface]
} pm_body_assembly;

// The names of the five quantities of a contact pair, indexed by pm_contact_group.
extern const char *const pm_contact_group_name[PM_CONTACT_GROUPS];

// Reads the names and placements of bodies from the key `beams` of the block `system` in the truth
// file at `path`. All bodies are in modes at first. The caller sets assembly->basis first and
// initialises the rest with zeros; it frees assembly->arena, after a failure too. PM_EFILE,
// PM_ECONFIG, PM_ENOMEM.
pm_status pm_body_assembly_read(pm_body_assembly *assembly, const char *path);
// Reads bodies as pm_body_assembly_read does, and finds their interfaces. Fails as both functions
// do.
pm_status pm_body_assembly_load(pm_body_assembly *assembly, const char *path);
// Makes a body a solid with the mesh of its field, which must outlive the assembly. Called before
// the interfaces are found. PM_EDATA: the field has no mesh.
pm_status pm_body_assembly_make_solid(pm_body_assembly *assembly, int body, const pm_field *field);

// Finds the interfaces between the bodies, and the contact nodes of solids. Two bodies with a third
// body between them have no interface. PM_EDATA (a body in modes without a basis, or with a basis
// without a mesh), PM_ENOMEM.
pm_status pm_body_assembly_find_interfaces(pm_body_assembly *assembly);

// Return true if a body is a solid, and the number of its coordinates in a contact: the amplitudes
// of its modes, or three displacements of each contact node.
bool pm_body_assembly_is_solid(const pm_body_assembly *assembly, int body);
int pm_body_assembly_size(const pm_body_assembly *assembly, int body);

// Computes how the quantities of an interface change with the coordinates of the body at one end:
// matrix [PM_CONTACT_GROUPS npair][pm_body_assembly_size], in m/J^0.5 and, for slopes, J^-0.5; for
// a solid in m/m and 1/m.
//
// A solid shows its true displacements, and the rest of this paragraph is about modes.
// The displacements are linear in the amplitudes. When a section rotates by the angle a, a side at
// the distance h from the axis comes closer to the axis by h/2 a^2, which linear modes cannot
// represent. The opening of a contact pair (bodies/solid/contact_pairs.h) contains the products u
// slope_u and v slope_v of a sliding displacement and a slope, and a slope is such an angle. The
// matrix therefore adds h/2 slope_u to the quantity u, and h/2 slope_v to v, so that the products
// contain h/2 a^2. PM_ENOMEM.
pm_status pm_contact_interface_matrix(const pm_body_assembly *assembly,
                                      const pm_contact_interface *interface, int end,
                                      double *matrix);

// Checks that the fields of the bodies, field [nbody], have the nodes of the bodies and agree in
// the number of trajectories, times and dt. PM_EDATA.
pm_status pm_body_assembly_check(const pm_body_assembly *assembly, const pm_field *const *field);

// Projects the trajectories whose numbers are `trajectory` [count] in the fields of all bodies,
// field [nbody], and writes them as one dataset. For each body it has the columns of
// pm_reduce_project or, for a solid, of pm_solid_nodes_dataset, with the body's name and "_" in
// front. `temperature`, in K, is that of solids. For each interface between bodies A and
// B it has the state of its part (contact_part.h): A_B_A<i>, A_B_B<i>, A_B_creep<i> and A_B_s.
// Creep and entropy are zero, because the contact of the ground truth neither creeps nor
// dissipates. PM_EDATA (the fields do not fit together), PM_ENOMEM. The caller frees the dataset.
pm_status pm_body_assembly_project(pm_dataset **dataset, const pm_body_assembly *assembly,
                                   const pm_field *const *field, int count, const int *trajectory,
                                   double temperature);

#endif
