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
//   placement, attribute of /                        optional: where the body lies, see below
// Other text attributes of / are notes.
#ifndef PM_BODIES_FIELD_H
#define PM_BODIES_FIELD_H

#include <stdbool.h>
#include <stddef.h>

#include "base/arena.h"
#include "base/status.h"
#include "store/yaml.h"

#define PM_FIELD_ENERGIES 3

// The variables of the nodes of a body: position, m, velocity, m/s, and Cauchy stress, Pa.
#define PM_BODY_VARIABLES "qx qy qz vx vy vz sxx syy szz sxy sxz syz"
#define PM_BODY_NVARIABLE 12

// --- placements ---

// The placement of a body: where the origin of its own frame lies in the global frame, and along
// which global axes its own axes point. Only quarter turns are possible, so that a rotation moves
// and negates components and is exact. Field files and configurations write a placement as
//     origin: [36, -26, 11], axes: [+y, -x, +z]      (m; own x points along global +y, ...)
typedef struct pm_placement {
    double origin[3]; // m, of the body's frame, in the global frame
    int axis[3];      // own axis d points along the global axis axis[d], 0 to 2 ...
    double sign[3];   // ... in its direction (1) or against it (-1); the rotation is proper
} pm_placement;

// The body's own frame is the global frame.
#define PM_PLACEMENT_IDENTITY ((pm_placement){{0, 0, 0}, {0, 1, 2}, {1, 1, 1}})

// Reads the keys `origin` and `axes` of a map; other keys are refused. The arena holds temporary
// text. On failure the placement is untouched. PM_ECONFIG: `origin` is not three numbers, or `axes`
// is not three different axes in right-handed order. PM_ENOMEM.
pm_status pm_placement_read(pm_yaml map, pm_arena *arena, pm_placement *placement);

// Convert the components [3] of a vector from the body's frame to the global frame, and back.
static inline void pm_placement_rotate(const pm_placement *placement, const double *own,
                                       double *global) {
    for (int d = 0; d < 3; ++d) {
        global[placement->axis[d]] = placement->sign[d] * own[d];
    }
}
static inline void pm_placement_rotate_back(const pm_placement *placement, const double *global,
                                            double *own) {
    for (int d = 0; d < 3; ++d) {
        own[d] = placement->sign[d] * global[placement->axis[d]];
    }
}

// Converts the coordinates [3] of a point, in m, from the body's frame to the global frame.
static inline void pm_placement_point(const pm_placement *placement, const double *own,
                                      double *global) {
    for (int d = 0; d < 3; ++d) {
        const int axis = placement->axis[d];
        global[axis] = placement->origin[axis] + placement->sign[d] * own[d];
    }
}

// --- fields ---

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
