// The placement of a body: where the origin of its own frame lies in the global frame, and along
// which global axes its own axes point. Only quarter turns are possible, so that a rotation moves
// and negates components and is exact. Field files and configurations write a placement as
//     origin: [36, -26, 11], axes: [+y, -x, +z]      (m; own x points along global +y, ...)
#ifndef PM_STORE_PLACEMENT_H
#define PM_STORE_PLACEMENT_H

#include "base/arena.h"
#include "base/status.h"
#include "store/yaml.h"

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

// Reads a placement from the attribute of a field file: the entries of such a map without its
// braces. Errors begin with `name`, which names the file. PM_EDATA, PM_ENOMEM.
pm_status pm_placement_parse(const char *text, const char *name, pm_placement *placement);

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

#endif
