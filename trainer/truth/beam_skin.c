// Finds the faces that belong to one element alone, by sorting all faces.
#include "truth/beam_skin.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// The corners of each side of an element, such that they turn to the left seen from outside.
static const int side[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                               {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};

// A side of an element, and its nodes in ascending order.
typedef struct sorted_side {
    int node[4], ascending[4];
} sorted_side;

static int compare_numbers(const void *a, const void *b) {
    const int x = *(const int *)a, y = *(const int *)b;
    return (x > y) - (x < y);
}

static int compare_sides(const void *a, const void *b) {
    const sorted_side *x = a, *y = b;
    for (int i = 0; i < 4; ++i) {
        if (x->ascending[i] != y->ascending[i]) {
            return x->ascending[i] < y->ascending[i] ? -1 : 1;
        }
    }
    return 0;
}

// Lists the sides of all elements in order, so that equal ones are neighbours.
static void sort_sides(const pm_beam_mesh *mesh, sorted_side *all) {
    for (int i = 0; i < 6 * mesh->nelement; ++i) {
        for (int k = 0; k < 4; ++k) {
            all[i].node[k] = mesh->hexahedron[i / 6][side[i % 6][k]];
        }
        memcpy(all[i].ascending, all[i].node, sizeof all[i].node);
        qsort(all[i].ascending, 4, sizeof *all[i].ascending, compare_numbers);
    }
    qsort(all, 6 * (size_t)mesh->nelement, sizeof *all, compare_sides);
}

// Computes centre, normal and area of a face, and its distance from the clamp.
static void measure_face(const pm_beam_mesh *mesh, pm_beam_face *face) {
    const double *a = mesh->position[face->node[0]], *b = mesh->position[face->node[1]],
                 *c = mesh->position[face->node[2]], *d = mesh->position[face->node[3]];
    double cross[3], square = 0;
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        cross[i] = ((c[j] - a[j]) * (d[k] - b[k]) - (c[k] - a[k]) * (d[j] - b[j])) / 2;
        square += cross[i] * cross[i];
        face->centre[i] = (a[i] + b[i] + c[i] + d[i]) / 4;
    }
    face->area = sqrt(square);
    for (int i = 0; i < 3; ++i) {
        face->outward[i] = cross[i] / face->area;
    }
    face->distance = INFINITY;
    for (int n = 0; n < mesh->nnode; ++n) {
        double away = 0;
        for (int i = 0; i < 3; ++i) {
            const double off = mesh->position[n][i] - face->centre[i];
            away += off * off;
        }
        face->distance = mesh->clamped[n] ? fmin(face->distance, sqrt(away)) : face->distance;
    }
}

// Lists the nodes of the faces, and the faces of each node. `number` [node of the mesh] is work
// space, -1 everywhere.
static void list_nodes(pm_beam_skin *skin, int *number) {
    for (int i = 0; i < 4 * skin->nface; ++i) {
        const int node = skin->face[i / 4].node[i % 4];
        if (number[node] < 0) {
            number[node] = skin->nnode;
            skin->node[skin->nnode++] = node;
        }
        ++skin->first[number[node] + 1];
    }
    for (int i = 0; i < skin->nnode; ++i) {
        skin->first[i + 1] += skin->first[i];
    }
    for (int i = 4 * skin->nface - 1; i >= 0; --i) {
        // first[n + 1] moves down to the start of node n.
        skin->face_at[--skin->first[number[skin->face[i / 4].node[i % 4]] + 1]] = i / 4;
    }
    memmove(skin->first, skin->first + 1, (size_t)skin->nnode * sizeof *skin->first);
    skin->first[skin->nnode] = 4 * skin->nface;
}

pm_status pm_beam_skin_make(pm_beam_skin *skin, const pm_beam_mesh *mesh, pm_arena *arena) {
    const size_t nside = 6 * (size_t)mesh->nelement, nnode = (size_t)mesh->nnode;
    *skin = (pm_beam_skin){0};
    sorted_side *all = pm_arena_array(arena, nside, sizeof *all);
    int *number = pm_arena_array(arena, nnode, sizeof *number);
    skin->face = pm_arena_array(arena, nside, sizeof *skin->face);
    skin->node = pm_arena_array(arena, nnode, sizeof *skin->node);
    skin->first = pm_arena_array(arena, nnode + 2, sizeof *skin->first);
    skin->face_at = pm_arena_array(arena, 4 * nside, sizeof *skin->face_at);
    if (all == NULL || number == NULL || skin->face == NULL || skin->node == NULL ||
        skin->first == NULL || skin->face_at == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    sort_sides(mesh, all);
    for (size_t i = 0; i < nside; ++i) {
        const bool twin = (i > 0 && compare_sides(&all[i], &all[i - 1]) == 0) ||
                          (i + 1 < nside && compare_sides(&all[i], &all[i + 1]) == 0);
        if (!twin) {
            pm_beam_face *face = &skin->face[skin->nface++];
            memcpy(face->node, all[i].node, sizeof face->node);
            measure_face(mesh, face);
            skin->farthest = fmax(skin->farthest, face->distance);
        }
    }
    memset(number, -1, nnode * sizeof *number);
    list_nodes(skin, number);
    return PM_OK;
}

const pm_beam_face *pm_beam_skin_draw(const pm_beam_skin *skin, double nearest, pm_rng *rng) {
    const double least = nearest * skin->farthest;
    const pm_beam_face *last = NULL;
    double total = 0;
    for (int i = 0; i < skin->nface; ++i) {
        total += skin->face[i].distance >= least ? skin->face[i].area : 0;
    }
    double left = total * pm_rng_uniform(rng);
    for (int i = 0; i < skin->nface; ++i) {
        if (skin->face[i].distance >= least) {
            last = &skin->face[i];
            left -= last->area;
            if (left < 0) {
                break;
            }
        }
    }
    return last; // the farthest face is always among them
}

bool pm_beam_skin_faces(const pm_beam_skin *skin, int i, const double *outward) {
    for (int k = skin->first[i]; k < skin->first[i + 1]; ++k) {
        const double *own = skin->face[skin->face_at[k]].outward;
        if (own[0] * outward[0] + own[1] * outward[1] + own[2] * outward[2] > sqrt(0.5)) {
            return true;
        }
    }
    return false;
}
