// Where a body lies in the world: the place of its origin, and which axes of the world its own are.
// Field files keep it as text: "origin: [36, -26, 11], axes: [+y, -x, +z]" (m).
#ifndef PM_STORE_PLACEMENT_H
#define PM_STORE_PLACEMENT_H

#include "base/status.h"

typedef struct pm_placement {
    double origin[3]; // m
    int axis[3];      // own axis d is the world's axis[d], 0 to 2 ...
    double sign[3];   // ... along it (1) or against it (-1)
} pm_placement;

// In the world's own frame.
#define PM_PLACEMENT_WORLD ((pm_placement){{0, 0, 0}, {0, 1, 2}, {1, 1, 1}})

// Reads the text; `name` stands for where it was found. PM_EDATA, PM_ENOMEM.
pm_status pm_placement_read(const char *text, const char *name, pm_placement *placement);

// A point of the body in the world.
static inline void pm_placement_point(const pm_placement *placement, const double *own,
                                      double *world) {
    for (int d = 0; d < 3; ++d) {
        const int axis = placement->axis[d];
        world[axis] = placement->origin[axis] + placement->sign[d] * own[d];
    }
}

#endif
