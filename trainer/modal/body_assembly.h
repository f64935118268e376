// Bodies of one basis placed in the world: who faces whom, how that depends on the amplitudes of
// modes, and what the fields of all of them are in these coordinates.
#ifndef PM_TRAINER_MODAL_BODY_ASSEMBLY_H
#define PM_TRAINER_MODAL_BODY_ASSEMBLY_H

#include "body/contact_pairs.h"
#include "modal/basis.h"
#include "model/part.h"
#include "store/dataset.h"
#include "store/field.h"

// Two bodies that face each other.
typedef struct pm_contact_interface {
    int body[2];
    pm_contact_pairs facing; // at least one pair
} pm_contact_interface;

typedef struct pm_body_assembly {
    pm_arena arena; // owns all but the basis
    const pm_basis *basis;
    int nbody;
    pm_placed *body; // [nbody]
    int ncontact;
    pm_contact_interface *meeting; // [ncontact]
} pm_body_assembly;

// Names of what is between two facing points, by pm_contact_group.
extern const char *const pm_contact_interface_group[PM_CONTACT_GROUPS];

// The bodies placed in a truth's configuration under system: beams:, and their meetings. `assembly`
// is zero but for the basis. PM_EFILE, PM_ECONFIG, PM_EDATA, PM_ENOMEM.
pm_status pm_body_assembly_load(pm_body_assembly *assembly, const char *path);

// Finds the meetings of the bodies, without those that have a third body between them. PM_EDATA,
// PM_ENOMEM.
pm_status pm_body_assembly_meet(pm_body_assembly *assembly);

// How fast the groups change per rate of the amplitudes of the state's modes of one end's body:
// matrix [PM_CONTACT_GROUPS npair][nstate]. Modes are linear: where a section turns they leave out
// that its sides come h/2 slope^2 closer to the axis, which lies h below (basis.h: what is carried
// along). So u and v are not those of the sides but half way to the axis, h/2 slope more.
// PM_ENOMEM.
pm_status pm_contact_interface_matrix(const pm_body_assembly *assembly,
                                      const pm_contact_interface *meeting, int end, double *matrix);

// Whether fields of the bodies, field [nbody], have the basis's nodes and the same trajectories,
// times and dt. PM_EDATA.
pm_status pm_body_assembly_check(const pm_body_assembly *assembly, const pm_field *const *field);

// What lies between two bodies of the assembly is made of.
typedef struct pm_gap_constants {
    double
        stiffness; // N/m of a pair of points: of the bodies' edges, which their modes do not have
    double creep;  // m/(N s), by which a pair opens while it is pressed; 0: it does not
} pm_gap_constants;

// The part between two bodies A and B. Its state: how far each has travelled since it was
// undeformed, groups A and B [nstate] each, to be joined with its p by a port of the law contact;
// what a pair has crept, `creep` [npair]; and the entropy s of that. The groups of
// pm_contact_interface_group are images of the travel; an opening g + creep + u slope_u + v slope_v
// = x stores stiffness/2 min(x,0)^2. The spec lies in the arena, and the caller frees the part
// (pm_part_free), also on failure. PM_ECONFIG (the name of a body is that of another group),
// PM_ENOMEM.
pm_status pm_contact_interface_part(const pm_body_assembly *assembly,
                                    const pm_contact_interface *meeting,
                                    const pm_gap_constants *constants, pm_arena *arena,
                                    pm_part *part);

// `count` trajectories of the fields of all bodies, field [nbody], as one dataset: the columns of
// pm_reduce_project with the body's name and "_" in front, and for each meeting the groups of its
// part in columns A_B_A<i>, A_B_B<i>, A_B_creep<i> and A_B_s; the last two are 0, as the truth's
// contact does neither. PM_EDATA (fields that do not fit together), PM_ENOMEM.
pm_status pm_body_assembly_project(pm_dataset **dataset, const pm_body_assembly *assembly,
                                   const pm_field *const *field, int count, const int *trajectory);

// What the rows of a dataset as pm_body_assembly_project writes it say about a meeting.
typedef struct pm_openings {
    const pm_contact_interface *meeting;
    int nstate;
    int travel[2], creep; // first columns
    double *matrix[2];    // of pm_contact_interface_matrix
    double *value;        // [PM_CONTACT_GROUPS][npair], of the last row
} pm_openings;

// Finds the columns; memory from the arena. PM_EDATA, PM_ENOMEM.
pm_status pm_openings_open(pm_openings *openings, const pm_body_assembly *assembly,
                           const pm_contact_interface *meeting, const pm_dataset *modes,
                           pm_arena *arena);
// The groups of pm_contact_interface_group in a row, what has crept being in g:
// [PM_CONTACT_GROUPS][npair], until the next call.
const double *pm_openings_at(const pm_openings *openings, const double *row);

// What presses on one body of an assembly, from the state of what lies between.
typedef struct pm_contact_force {
    const pm_body_assembly *assembly;
    int body;
    double stiffness;      // N/m of an opening, as in the scene
    pm_openings *openings; // [ncontact], of the body's meetings
    double *effort;        // work space
} pm_contact_force;

// Finds the columns of the body's meetings in a dataset as pm_body_assembly_project writes it;
// memory from the arena. PM_EDATA, PM_ENOMEM.
pm_status pm_contact_force_open(pm_contact_force *touch, const pm_body_assembly *assembly, int body,
                                const pm_dataset *modes, double stiffness, pm_arena *arena);
// Adds to f [nnode][3] N, in the body's frame, the forces of contact on its nodes in a state `row`
// of that dataset, where an opening x stores stiffness/2 min(x,0)^2.
void pm_contact_force_add_forces(const pm_contact_force *touch, const double *row, double *f);

// How far off the force of a meeting is in a dataset of modes: error [modes->ntrajectory], the
// relative L2 error over a trajectory of the total normal force, where an opening x gives the force
// -stiffness min(x,0), against that of the forces of contact in the field of whichever body meets
// nobody else; trajectory [modes->ntrajectory] says which of the field's. NAN where nothing
// touches. PM_EDATA (columns, states, fields that do not fit together, no forces of contact, no
// such body), PM_ENOMEM.
pm_status pm_contact_interface_force_errors(const pm_body_assembly *assembly,
                                            const pm_contact_interface *meeting,
                                            const pm_dataset *modes, double stiffness,
                                            const pm_field *const *field, const int *trajectory,
                                            double *error);

#endif
