// The placement of a body: the position of its origin in the global frame, and the global axis
// along which each of its own axes points. Field files keep it as text, such as "origin: [36, -26,
// 11], axes: [+y, -x, +z]", in m.
#ifndef PM_STORE_PLACEMENT_H
#define PM_STORE_PLACEMENT_H

#include "base/status.h"

typedef struct pm_placement {
    double origin[3]; // m
    int axis[3];      // the body's axis d lies along the global axis[d], 0 to 2, ...
    double sign[3];   // ... in the same (1) or the opposite (-1) direction
} pm_placement;

// The placement of a body whose frame is the global frame.
#define PM_PLACEMENT_WORLD ((pm_placement){{0, 0, 0}, {0, 1, 2}, {1, 1, 1}})

// Parses the text; `name` tells errors where it was found. PM_EDATA, PM_ENOMEM.
pm_status pm_placement_read(const char *text, const char *name, pm_placement *placement);

// Converts a point own [3], m, from the body's frame to the global frame: global [3], m.
static inline void pm_placement_point(const pm_placement *placement, const double *own,
                                      double *global) {
    for (int d = 0; d < 3; ++d) {
        const int axis = placement->axis[d];
        global[axis] = placement->origin[axis] + placement->sign[d] * own[d];
    }
}

#endif
