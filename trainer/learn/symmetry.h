// Symmetric copies of training samples: what is learned on a mesh that is as symmetric as a square
// (body/symmetry_copies.h) is learned from all eight images of each sample.
#ifndef PM_TRAINER_LEARN_SYMMETRY_H
#define PM_TRAINER_LEARN_SYMMETRY_H

#include "body/symmetry_copies.h"
#include "learn/samples.h"
#include "scene/system.h"

// A field within a window: scalars, vectors or symmetric tensors (xx yy zz xy xz yz) at the nodes.
typedef struct pm_window_field {
    int first, components;
} pm_window_field;

struct pm_symmetry {
    int nnode, nfield;
    pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE];
    const pm_window_field *field; // [nfield]
};

// For windows of `unroll` steps with `input_order` coefficients of the loads. All groups with 1, 3
// or 6 numbers per node of the mesh are fields, of subsystems and of loads; all others are the same
// in all copies. Memory from the arena. PM_ECONFIG: no model has a mesh, or two differ, or it is
// not square; PM_ENOMEM.
pm_status pm_symmetry_make(pm_symmetry **symmetry, const pm_system *system, int unroll,
                           int input_order, pm_arena *arena);

// The image number `copy` of a window; both [width], not the same.
void pm_symmetry_image(const pm_symmetry *s, int copy, int width, const double *window,
                       double *image);

#endif
