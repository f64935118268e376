// The truth simulator of beams: one box of viscoelastic rubber, several boxes in contact, or a body
// of any shape from a file, and the loads on one of them (beam_solve.h). It writes the fields of
// each body in its own frame. The variables of a node are q (position), v (velocity, by backward
// differences of second order over the last steps) and sigma (Cauchy stress, xx yy zz xy xz yz).
#ifndef PM_BODIES_TRUTH_BEAM_H
#define PM_BODIES_TRUTH_BEAM_H

#include "base/rng.h"
#include "bodies/field/field.h"
#include "bodies/truth/beam_material.h"
#include "bodies/truth/beam_mesh.h"
#include "truth/truth.h"

// --- the mesh ---

// Makes one body whose frame is the global frame. Memory comes from the arena. PM_ENOMEM.
pm_status pm_beam_mesh_make(pm_beam_mesh *mesh, const int count[3], const double size[3],
                            pm_arena *arena);
// Makes equal bodies at placement [nbody]. Memory comes from the arena. PM_ENOMEM.
pm_status pm_beam_mesh_place(pm_beam_mesh *mesh, const int count[3], const double size[3],
                             int nbody, const pm_placement *placement, pm_arena *arena);
// Makes one body of the mesh in a file (store/solid_mesh.h). Memory comes from the arena. PM_EFILE;
// PM_EDATA: the file holds no mesh, or no node or every node is clamped; PM_ENOMEM.
pm_status pm_beam_mesh_load(pm_beam_mesh *mesh, const char *path, pm_arena *arena);

// --- the surface of a body of any shape: the faces that belong to one element alone ---

typedef struct pm_beam_face {
    int node[4];
    double centre[3];  // m, undeformed
    double outward[3]; // unit normal
    double area;       // m^2
    double distance;   // m, of the centre from the nearest clamped node
} pm_beam_face;

typedef struct pm_beam_skin {
    int nface, nnode;
    pm_beam_face *face;   // [nface]
    int *node;            // [nnode] nodes of these faces
    int *first, *face_at; // [nnode + 1], [4 nface] the faces of each of these nodes
    double farthest;      // m, the largest distance of a face
} pm_beam_skin;

// Finds the surface of a single body. Memory comes from the arena. PM_ENOMEM.
pm_status pm_beam_skin_make(pm_beam_skin *skin, const pm_beam_mesh *mesh, pm_arena *arena);

// Draws a face, each with a probability proportional to its area, among those whose distance is at
// least the share `nearest` of the largest one.
const pm_beam_face *pm_beam_skin_draw(const pm_beam_skin *skin, double nearest, pm_rng *rng);

// Returns true if a face of node number i of the surface has a normal within 45 degrees of
// `outward`.
bool pm_beam_skin_faces(const pm_beam_skin *skin, int i, const double *outward);

// --- loads ---

// Loads on a beam: equal forces on some nodes of its surface, fixed in direction, whose size is a
// piecewise linear function of time.
#define PM_BEAM_MAX_LOADED 2048 // nodes of a face
#define PM_BEAM_KNOTS 4
#define PM_BEAM_FACES 4

typedef struct pm_beam_load {
    int body;
    int nnode;
    int node[PM_BEAM_MAX_LOADED];   // of the body, numbered as if it were alone
    double force[3];                // N on each node at full load, in the body's own frame
    double time[PM_BEAM_KNOTS];     // s, ascending
    double fraction[PM_BEAM_KNOTS]; // of the full load at these times; the first is 0
} pm_beam_load;

// The functions below make loads on body 0. Faces 0 to 3 are y = top, z = top, y = 0, z = 0, and
// the loads press inwards.

// Puts a load on one row of nodes across a face, number `position` counted from the free end. The
// force on each node rises to `force` N within `ramp` s and then stays constant.
void pm_beam_load_row(pm_beam_load *load, const pm_beam_mesh *mesh, int face, int position,
                      double force, double ramp);

// The ranges [lowest, highest] from which random loads are drawn uniformly.
typedef struct pm_beam_patches {
    double force[2];  // N, total
    double length[2]; // m, along the beam
    double width[2];  // m, across it
    int face;         // -1: any face
    double tilt;      // standard deviation of the force's tangential components over its normal one
    double ramp[2], hold[2], unload[2]; // s
} pm_beam_patches;

// Draws a rectangular patch of loaded nodes on a face, with its centre in the outer three fifths of
// the beam. The load rises, stays, and falls to zero.
void pm_beam_load_patch(pm_beam_load *load, const pm_beam_mesh *mesh,
                        const pm_beam_patches *patches, pm_rng *rng);

// Draws a patch of loaded nodes on a body of any shape: the part of the surface around a random
// point that faces the same way. `length` lies along the direction in the surface that is closest
// to x. `face` has no effect. The distance from the nearest clamped node takes the place of that
// along the beam.
void pm_beam_load_skin(pm_beam_load *load, const pm_beam_mesh *mesh, const pm_beam_skin *skin,
                       const pm_beam_patches *patches, pm_rng *rng);

// Computes the forces on all nodes at time t s: f [nnode][3], N, in the global frame.
void pm_beam_load_at(const pm_beam_load *load, const pm_beam_mesh *mesh, double t, double *f);

// --- the system ---

typedef struct pm_beam_system {
    const char *file; // of the mesh, as the configuration names it; NULL: boxes
    pm_beam_mesh mesh;
    pm_beam_skin skin; // of a body from a file
    pm_beam_material material;
    const char *const *name;      // [nbody]; NULL: one beam without a name
    const char *const *placement; // [nbody] as text
    double contact;               // Pa/m, penalty stiffness per area
    int substeps;                 // time steps per state
    int loaded;                   // the body on which the load acts
    int positions;                // load positions on each face; 0: the loads are random patches
    double force;                 // N on each node of a row
    double ramp;                  // s, until a row has its full load
    pm_beam_patches patches;
} pm_beam_system;

// Reads the `system:` block of a truth file. The pm_beam_system becomes `ode.data` of the model.
// Memory from the arena. PM_ECONFIG, PM_ENOMEM; PM_EFILE, PM_EDATA: a mesh cannot be read.
pm_status pm_beam_read(pm_yaml block, pm_arena *arena, pm_truth_model *model);

// Fills in the mesh of a body's field, in the body's own frame.
void pm_beam_describe(const pm_beam_system *system, int body, pm_field *field);

// Simulates trajectory `trajectory` of this seed and writes it into row `row` of the fields
// field [nbody], each in its body's own frame. PM_ECONFIG (there is no such trajectory),
// PM_ENUMERIC, PM_ENOMEM.
pm_status pm_beam_run(const pm_beam_system *system, uint64_t seed, int trajectory,
                      pm_field *const *field, int row);

#endif
