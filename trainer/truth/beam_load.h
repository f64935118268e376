// Loads on a beam: equal forces on some nodes of its surface, fixed in direction, whose size is a
// piecewise linear function of time.
#ifndef PM_TRAINER_TRUTH_BEAM_LOAD_H
#define PM_TRAINER_TRUTH_BEAM_LOAD_H

#include "base/rng.h"
#include "truth/beam_skin.h"

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

// Does the same on a body of any shape: the patch is the part of the surface around a random point
// that faces the same way, and `length` lies along the direction in the surface that is closest to
// x. `face` has no effect. The distance from the nearest clamped node takes the place of that along
// the beam.
void pm_beam_load_skin(pm_beam_load *load, const pm_beam_mesh *mesh, const pm_beam_skin *skin,
                       const pm_beam_patches *patches, pm_rng *rng);

// Computes the forces on all nodes at time t s: f [nnode][3], N, in the global frame.
void pm_beam_load_at(const pm_beam_load *load, const pm_beam_mesh *mesh, double t, double *f);

#endif
