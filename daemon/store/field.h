// Trajectories of fields on a mesh of hexahedra in HDF5:
//   /z           [trajectory][time][node][variable]  nodal values
//   /t           [time]                              s
//   /dt          scalar                              s
//   /f           [trajectory][time][node][3]         N, external forces on the nodes; a file may
//                                                    leave out the first time, where they are zero
//   /node_position_reference  [node][3]              m, undeformed
//   /hexahedra   [element][8]                        optional: nodes in the order of VTK
//   /energy      [trajectory][time][3]               optional: J, stored, dissipated, and work of
//                                                    the forces
//   /clamped     [node]                              1 or 0; written but not read
//   /contact_force  [trajectory][time][node][3]      of bodies in contact: N, from the other bodies
//   /contact_force_total  [trajectory][time][3]      N, sum over the nodes; written but not read
//   /contact_work  [trajectory][time]                J, of the contact forces; written but not read
//   state_layout, attribute of /                     names of the variables, separated by blanks; a
//                                                    remark may follow
//   placement, attribute of /                        optional: where the body lies (placement.h)
// Other text attributes of / are notes.
#ifndef PM_STORE_FIELD_H
#define PM_STORE_FIELD_H

#include <stdbool.h>
#include <stddef.h>

#include "base/arena.h"
#include "base/status.h"
#include "store/placement.h"

#define PM_FIELD_ENERGIES 3

typedef struct pm_field {
    pm_arena arena; // owns all that follows
    int ntrajectory, ntime, nnode, nvariable, nelement;
    double dt;            // s
    double *t;            // [ntime] s
    double *z;            // [ntrajectory][ntime][nnode][nvariable]
    double *f;            // [ntrajectory][ntime][nnode][3] N
    double *contact;      // [ntrajectory][ntime][nnode][3] N; NULL: no contact
    double *contact_work; // [ntrajectory][ntime] J; NULL: unknown, as after loading
    double *position;     // [nnode][3] m
    double *hexahedron;   // [nelement][8] nodes; NULL: unknown
    double *clamped;      // [nnode] 1 or 0; NULL: unknown, as after loading
    double *energy;       // [ntrajectory][ntime][PM_FIELD_ENERGIES] J; NULL: unknown
    const char *variable; // names of the variables, separated by blanks
    bool placed;          // the file has a placement; false: `placement` is the global frame
    pm_placement placement;
} pm_field;

typedef struct pm_field_shape {
    int ntrajectory, ntime, nnode, nvariable, nelement;
    bool contact;
} pm_field_shape;

// Makes a field to be filled: values are zero and t = i dt [s]; `variable` is copied. PM_ENOMEM.
// The caller frees.
pm_status pm_field_new(pm_field **field, pm_field_shape shape, double dt, const char *variable);
// Loads and checks a field. PM_EFILE: missing, truncated, or not HDF5; PM_EDATA: wrong shapes or
// names, a value that is not finite, or times that are not dt apart; PM_ENOMEM. The caller frees.
pm_status pm_field_load(pm_field **field, const char *path);
// Writes a field with `count` notes, each a name and a text; the file appears whole or not at all.
// PM_EFILE, PM_ENOMEM.
pm_status pm_field_save(const pm_field *field, const char *path, int count,
                        const char *const (*note)[2]);
void pm_field_free(pm_field *field); // NULL is allowed

// Finds consecutive variables by their names, separated by single blanks, such as "qx qy qz".
// Returns the column of the first one, or -1 if the field does not have these variables side by
// side.
int pm_field_columns(const pm_field *field, const char *names);

// Return nodal values [nnode][nvariable] and external forces [nnode][3], N, of trajectory i at time
// j.
static inline double *pm_field_state(const pm_field *d, int i, int j) {
    return d->z + ((size_t)i * (size_t)d->ntime + (size_t)j) * (size_t)(d->nnode * d->nvariable);
}
static inline double *pm_field_force(const pm_field *d, int i, int j) {
    return d->f + ((size_t)i * (size_t)d->ntime + (size_t)j) * (size_t)(d->nnode * 3);
}
// Returns contact forces [nnode][3], N, of trajectory i at time j, where the field has them.
static inline double *pm_field_contact(const pm_field *d, int i, int j) {
    return d->contact + (pm_field_force(d, i, j) - d->f);
}

#endif
