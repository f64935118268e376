// Trajectories of fields on a mesh, HDF5:
//   /z [trajectory][time][node][variable], /t [time] s, /dt scalar s,
//   /f [trajectory][time][node][3] N, forces of the world on the nodes (a file may leave out the
//      first time, whose forces are then zero),
//   /node_position_reference [node][3] m, undeformed,
//   /hexahedra [element][8] nodes in the order of VTK (a file may leave them out),
//   /clamped [node] 1 or 0 (written, not read),
//   /energy [trajectory][time][3] J: stored, dissipated, work of the forces (a file may leave them
//      out),
//   of a body in contact with others: /contact_force [trajectory][time][node][3] N, what these
//      exert on the nodes, and, written, not read: /contact_force_total [trajectory][time][3] N,
//      its sum, /contact_work [trajectory][time] J,
//   attribute state_layout of /: the variables' names separated by blanks, then any remark;
//   attribute placement of /, if the body lies elsewhere in the world: placement.h; other text
//   attributes of / are notes.
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
    double *contact_work; // [ntrajectory][ntime] J; NULL if read from a file
    double *position;     // [nnode][3] m
    double *hexahedron;   // [nelement][8]; NULL: not known
    double *clamped;      // [nnode]; NULL if read from a file, or not known
    double *energy;       // [ntrajectory][ntime][PM_FIELD_ENERGIES] J; NULL: not known
    const char *variable; // their names, separated by blanks
    bool placed;          // it says where it lies; else in the world's frame
    pm_placement placement;
} pm_field;

typedef struct pm_field_shape {
    int ntrajectory, ntime, nnode, nvariable, nelement;
    bool contact;
} pm_field_shape;

// Makes an empty one to be filled: zeroed, t = i dt. PM_ENOMEM. The caller frees.
pm_status pm_field_new(pm_field **field, pm_field_shape shape, double dt, const char *variable);
// PM_EFILE (missing, truncated, not HDF5), PM_EDATA (shapes, names, a value that is not finite,
// times that are not dt apart), PM_ENOMEM. The caller frees.
pm_status pm_field_load(pm_field **field, const char *path);
// With `count` notes: names and texts in turn.
pm_status pm_field_save(const pm_field *field, const char *path, int count,
                        const char *const (*note)[2]);
void pm_field_free(pm_field *field); // NULL is allowed

// The first of the variables that have these names, separated by single blanks, in a row; -1: none.
int pm_field_columns(const pm_field *field, const char *names);

// Nodal values [nnode][nvariable] and forces [nnode][3] of trajectory i at time j.
static inline double *pm_field_state(const pm_field *d, int i, int j) {
    return d->z + ((size_t)i * (size_t)d->ntime + (size_t)j) * (size_t)(d->nnode * d->nvariable);
}
static inline double *pm_field_force(const pm_field *d, int i, int j) {
    return d->f + ((size_t)i * (size_t)d->ntime + (size_t)j) * (size_t)(d->nnode * 3);
}
// Forces of contact [nnode][3], where there are any.
static inline double *pm_field_contact(const pm_field *d, int i, int j) {
    return d->contact + (pm_field_force(d, i, j) - d->f);
}

#endif
