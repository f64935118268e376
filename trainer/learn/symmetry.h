// Symmetric copies of training samples. A body on a mesh with a square cross-section looks the same
// in eight orientations (body/symmetry_copies.h), so that each sample also exists in eight copies.
#ifndef PM_TRAINER_LEARN_SYMMETRY_H
#define PM_TRAINER_LEARN_SYMMETRY_H

#include "body/symmetry_copies.h"
#include "learn/samples.h"
#include "scene/system.h"

// A field within a window: 1, 3 or 6 components at each node, that is, scalars, vectors or
// symmetric tensors (xx yy zz xy xz yz).
typedef struct pm_window_field {
    int first, components; // `first` is its position in the window
} pm_window_field;

struct pm_symmetry {
    int nnode, nfield;
    pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE];
    const pm_window_field *field; // [nfield]
};

// Describes the fields in windows of `unroll` steps with `input_order` coefficients of the boundary
// inputs. Every group of a subsystem or boundary input with 1, 3 or 6 numbers per node of the mesh
// is a field. All other groups have the same values in all copies. The result lives in the arena.
// PM_ECONFIG: no model has a mesh, two meshes differ, or the mesh is not square; PM_ENOMEM.
pm_status pm_symmetry_make(pm_symmetry **symmetry, const pm_system *system, int unroll,
                           int input_order, pm_arena *arena);

// Writes copy number `copy` of a window to `image`. Both are [width] and must not overlap.
void pm_symmetry_image(const pm_symmetry *s, int copy, int width, const double *window,
                       double *image);

#endif
