// Sorts all faces of all elements, so that a face that two elements share stands beside its twin.
#include "body/surface.h"

#include <stdbool.h>
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

// Fills in all faces, face [6 nelement].
static void list_faces(int nelement, const double *hexahedron, pm_surface_face *face) {
    static const int corner[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                     {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
    for (int i = 0; i < 6 * nelement; ++i) {
        for (int k = 0; k < 4; ++k) {
            face[i].node[k] = (int)hexahedron[8 * (ptrdiff_t)(i / 6) + corner[i % 6][k]];
        }
        memcpy(face[i].sorted, face[i].node, sizeof face[i].sorted);
        qsort(face[i].sorted, 4, sizeof *face[i].sorted, compare_nodes);
    }
}

pm_status pm_surface_find(pm_surface *surface, int nelement, const double *hexahedron,
                          pm_arena *arena) {
    const size_t count = 6 * (size_t)nelement;
    pm_surface_face *all = pm_arena_array(arena, count, sizeof *all);
    if (all == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the surface of a body");
    }
    list_faces(nelement, hexahedron, all);
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
