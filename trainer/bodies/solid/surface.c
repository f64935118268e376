// Sorts all faces of all elements, so that a face that two elements share stands beside its twin.
#include "bodies/solid/surface.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

static int compare_nodes(const void *a, const void *b) {
    return *(const int *)a - *(const int *)b;
}

static int compare_faces(const void *a, const void *b) {
    const pm_surface_face *x = a, *y = b;
    for (int i = 0; i < 4; ++i) {
        if (x->sorted[i] != y->sorted[i]) {
            return x->sorted[i] - y->sorted[i];
        }
    }
    return 0;
}

pm_status pm_surface_find(pm_surface *surface, int nelement, const double *hexahedron,
                          pm_arena *arena) {
    static const int corner[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                     {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
    const size_t count = 6 * (size_t)nelement;
    pm_surface_face *all = pm_arena_array(arena, count, sizeof *all);
    PM_TRY(pm_arena_status(arena, "the surface of a body"));
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < 4; ++k) {
            all[i].node[k] = (int)hexahedron[8 * (i / 6) + (size_t)corner[i % 6][k]];
        }
        memcpy(all[i].sorted, all[i].node, sizeof all[i].sorted);
        qsort(all[i].sorted, 4, sizeof *all[i].sorted, compare_nodes);
    }
    qsort(all, count, sizeof *all, compare_faces);
    int found = 0;
    for (size_t i = 0, same = 1; i < count; i += same) {
        for (same = 1; i + same < count && compare_faces(&all[i], &all[i + same]) == 0;) {
            ++same;
        }
        if (same == 1) {
            all[found++] = all[i];
        }
    }
    *surface = (pm_surface){.nface = found, .face = all};
    return PM_OK;
}
