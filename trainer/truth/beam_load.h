// What presses on a beam: equal forces on some nodes of its surface, fixed in direction, whose size
// follows a polyline in time.
#ifndef PM_TRAINER_TRUTH_BEAM_LOAD_H
#define PM_TRAINER_TRUTH_BEAM_LOAD_H

#include "base/rng.h"
#include "truth/beam_mesh.h"

#define PM_BEAM_MAX_LOADED 2048 // what a face may have
#define PM_BEAM_KNOTS 4
#define PM_BEAM_FACES 4

typedef struct pm_beam_load {
    int body;
    int nnode;
    int node[PM_BEAM_MAX_LOADED];   // of the body, numbered as if it were alone
    double force[3];                // N on each node, in full, in the body's frame
    double time[PM_BEAM_KNOTS];     // s, ascending
    double fraction[PM_BEAM_KNOTS]; // of the full load, from the start's 0 on
} pm_beam_load;

// Faces 0..3 are y = top, z = top, y = 0, z = 0; loads press inwards. They are made for body 0.

// A row of nodes across a face, the `position`th from the free end; `force` on each node is full
// after `ramp` s, and stays.
void pm_beam_load_row(pm_beam_load *load, const pm_beam_mesh *mesh, int face, int position,
                      double force, double ramp);

// From what random loads are drawn, evenly between a lowest and a highest value.
typedef struct pm_beam_patches {
    double force[2];  // N, in all
    double length[2]; // m, along the beam
    double width[2];  // m, across it
    int face;         // -1: any
    double tilt;      // standard deviation of the direction's parts along the face, by that into it
    double ramp[2], hold[2], unload[2]; // s
} pm_beam_patches;

// A patch on the face, its centre in the outer three fifths of the beam: ramp, hold, unload.
void pm_beam_load_patch(pm_beam_load *load, const pm_beam_mesh *mesh,
                        const pm_beam_patches *patches, pm_rng *rng);

// f [nnode][3], N, in the world, at time t.
void pm_beam_load_at(const pm_beam_load *load, const pm_beam_mesh *mesh, double t, double *f);

#endif
