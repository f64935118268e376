// Sides of a body are the faces of its elements that belong to one element only.
#include "body/contact_pairs.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define PARALLEL 0.999  // cosine, of normals that count as equal
#define TOLERANCE 1e-6  // of an element's size
#define NEWTON_STEPS 10 // each doubles the digits: to rounding with room to spare

typedef struct face {
    int node[4];
    double corner[4][3]; // in the world, m
    double normal[3];    // outwards
    double size;         // m
} face;

typedef struct skin {
    int count;
    face *face;
} skin;

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for the sides of a body");
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static double normalise(double *a) {
    const double length = sqrt(dot(a, a));
    for (int d = 0; d < 3; ++d) {
        a[d] /= length;
    }
    return length;
}

static void to_world(const pm_placed *body, const double *own, double *world) {
    for (int d = 0; d < 3; ++d) {
        world[d] =
            own[0] * body->axis[0][d] + own[1] * body->axis[1][d] + own[2] * body->axis[2][d];
    }
}

// --- the skin of a body ---

static int compare_numbers(const void *a, const void *b) {
    return *(const int *)a - *(const int *)b;
}

typedef struct keyed_face {
    int key[4]; // its nodes in order
    int node[4];
} keyed_face;

static int compare_faces(const void *a, const void *b) {
    const keyed_face *x = a, *y = b;
    for (int i = 0; i < 4; ++i) {
        if (x->key[i] != y->key[i]) {
            return x->key[i] - y->key[i];
        }
    }
    return 0;
}

static keyed_face *list_faces(const pm_placed *body, pm_arena *arena) {
    static const int corner[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                     {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
    keyed_face *all = pm_arena_array(arena, 6 * (size_t)body->nelement, sizeof *all);
    for (int i = 0; i < 6 * body->nelement && all != NULL; ++i) {
        for (int k = 0; k < 4; ++k) {
            all[i].node[k] = (int)body->hexahedron[8 * (ptrdiff_t)(i / 6) + corner[i % 6][k]];
        }
        memcpy(all[i].key, all[i].node, sizeof all[i].key);
        qsort(all[i].key, 4, sizeof *all[i].key, compare_numbers);
    }
    return all;
}

static face place_face(const pm_placed *body, const int *node) {
    face f;
    double diagonal[2][3];
    for (int k = 0; k < 4; ++k) {
        f.node[k] = node[k];
        to_world(body, body->position + 3 * (ptrdiff_t)node[k], f.corner[k]);
        for (int d = 0; d < 3; ++d) {
            f.corner[k][d] += body->origin[d];
        }
    }
    for (int d = 0; d < 3; ++d) {
        diagonal[0][d] = f.corner[2][d] - f.corner[0][d];
        diagonal[1][d] = f.corner[3][d] - f.corner[1][d];
    }
    cross(diagonal[0], diagonal[1], f.normal);
    f.size = sqrt(normalise(f.normal));
    return f;
}

static pm_status find_skin(skin *s, const pm_placed *body, pm_arena *arena) {
    if (body->nelement == 0) {
        return pm_fail(PM_EDATA, "%s: the basis has no mesh, whose sides could touch", body->name);
    }
    const size_t count = 6 * (size_t)body->nelement;
    keyed_face *all = list_faces(body, arena);
    s->face = pm_arena_array(arena, count, sizeof *s->face);
    if (all == NULL || s->face == NULL) {
        return no_memory();
    }
    qsort(all, count, sizeof *all, compare_faces);
    s->count = 0;
    for (size_t i = 0; i < count; ++i) {
        const bool twice = (i > 0 && compare_faces(&all[i], &all[i - 1]) == 0) ||
                           (i + 1 < count && compare_faces(&all[i], &all[i + 1]) == 0);
        if (!twice) {
            s->face[s->count++] = place_face(body, all[i].node);
        }
    }
    return PM_OK;
}

// --- points of a skin ---

// Bilinear weights of the corners at (x, y) in the unit square, and their derivatives.
static void weigh(double x, double y, double weight[4], double slope[2][4]) {
    const double by_x[4] = {y - 1, 1 - y, y, -y}, by_y[4] = {x - 1, -x, x, 1 - x};
    weight[0] = (1 - x) * (1 - y);
    weight[1] = x * (1 - y);
    weight[2] = x * y;
    weight[3] = (1 - x) * y;
    memcpy(slope[0], by_x, sizeof by_x);
    memcpy(slope[1], by_y, sizeof by_y);
}

// The point of the face whose tangential coordinates are those of `at`: weights of its corners,
// their slopes along both tangents. False: it does not lie on the face.
static bool look_up(const face *f, const pm_contact_pair *pair, const double *at, double weight[4],
                    double slope[2][4]) {
    double xy[2] = {0.5, 0.5}, inverse[2][2], local[2][4];
    for (int step = 0; step < NEWTON_STEPS; ++step) {
        double off[2], jacobian[2][2] = {{0}}; // [tangent][x or y]
        weigh(xy[0], xy[1], weight, local);
        for (int t = 0; t < 2; ++t) {
            off[t] = dot(pair->tangent[t], at);
            for (int k = 0; k < 4; ++k) {
                const double place = dot(pair->tangent[t], f->corner[k]);
                off[t] -= weight[k] * place;
                jacobian[t][0] += local[0][k] * place;
                jacobian[t][1] += local[1][k] * place;
            }
        }
        const double area = jacobian[0][0] * jacobian[1][1] - jacobian[0][1] * jacobian[1][0];
        inverse[0][0] = jacobian[1][1] / area;
        inverse[0][1] = -jacobian[0][1] / area;
        inverse[1][0] = -jacobian[1][0] / area;
        inverse[1][1] = jacobian[0][0] / area;
        for (int i = 0; i < 2; ++i) {
            xy[i] += inverse[i][0] * off[0] + inverse[i][1] * off[1];
        }
    }
    weigh(xy[0], xy[1], weight, local);
    for (int t = 0; t < 2; ++t) {
        for (int k = 0; k < 4; ++k) {
            slope[t][k] = local[0][k] * inverse[0][t] + local[1][k] * inverse[1][t];
        }
    }
    return xy[0] > -TOLERANCE && xy[0] < 1 + TOLERANCE && xy[1] > -TOLERANCE &&
           xy[1] < 1 + TOLERANCE;
}

// PM_EDATA: more faces meet there than a point has room for.
static pm_status add_corner(pm_contact_point *point, int node, double value, double slope_u,
                            double slope_v) {
    int i = 0;
    while (i < point->nnode && point->node[i] != node) {
        ++i;
    }
    if (i == PM_CONTACT_MOST_NODES) {
        return pm_fail(PM_EDATA, "the faces that meet at a point have more than %d nodes",
                       PM_CONTACT_MOST_NODES);
    }
    point->nnode = i == point->nnode ? i + 1 : point->nnode;
    point->node[i] = node;
    point->value[i] += value;
    point->slope[0][i] += slope_u;
    point->slope[1][i] += slope_v;
    return PM_OK;
}

static double distance_to(const face *f, const pm_contact_pair *pair, const double *at,
                          const double weight[4]) {
    double distance = -dot(pair->normal, at);
    for (int k = 0; k < 4; ++k) {
        distance += weight[k] * dot(pair->normal, f->corner[k]);
    }
    return distance;
}

// The point of a skin that looks along `sign` times the pair's normal, across from `at` and nearest
// to it: the mean over the faces that meet there. Not found: there is none.
static pm_status find_point(const skin *s, const pm_contact_pair *pair, double sign,
                            const double *at, pm_contact_point *point, double *distance,
                            bool *found) {
    double weight[4], slope[2][4];
    int nface = 0;
    *point = (pm_contact_point){0};
    for (int i = 0; i < s->count; ++i) {
        const face *f = &s->face[i];
        if (sign * dot(f->normal, pair->normal) < PARALLEL ||
            !look_up(f, pair, at, weight, slope)) {
            continue;
        }
        const double far = distance_to(f, pair, at, weight), close = TOLERANCE * f->size;
        if (far < -close || (nface > 0 && far > *distance + close)) {
            continue;
        }
        if (nface == 0 || far < *distance - close) {
            *point = (pm_contact_point){0};
            nface = 0;
        }
        *distance = far;
        ++nface;
        for (int k = 0; k < 4; ++k) {
            PM_TRY(add_corner(point, f->node[k], weight[k], slope[0][k], slope[1][k]));
        }
    }
    for (int i = 0; i < point->nnode; ++i) {
        point->value[i] /= nface;
        point->slope[0][i] /= nface;
        point->slope[1][i] /= nface;
    }
    *found = nface > 0;
    return PM_OK;
}

// --- pairs ---

// How long the side is along a tangent that looks along `sign` times the normal.
static double length_of(const skin *s, const pm_contact_pair *pair, double sign, int tangent) {
    double low = INFINITY, high = -INFINITY;
    for (int i = 0; i < s->count; ++i) {
        for (int k = 0; k < 4 && sign * dot(s->face[i].normal, pair->normal) >= PARALLEL; ++k) {
            const double at = dot(pair->tangent[tangent], s->face[i].corner[k]);
            low = fmin(low, at);
            high = fmax(high, at);
        }
    }
    return high - low;
}

static void share_slopes(const skin skins[2], pm_contact_pair *pair) {
    for (int t = 0; t < 2; ++t) {
        const double first = length_of(&skins[0], pair, 1, t);
        const double second = length_of(&skins[1], pair, -1, t);
        const bool equal = fabs(first - second) <= TOLERANCE * (first + second);
        pair->point[0].share[t] = equal ? 0.5 : first > second;
        pair->point[1].share[t] = 1 - pair->point[0].share[t];
    }
}

// The normal of a face, and a tangent along its first edge.
static void set_frame(pm_contact_pair *pair, const face *f) {
    memcpy(pair->normal, f->normal, sizeof pair->normal);
    for (int d = 0; d < 3; ++d) {
        pair->tangent[0][d] = f->corner[1][d] - f->corner[0][d];
    }
    normalise(pair->tangent[0]);
    cross(pair->normal, pair->tangent[0], pair->tangent[1]);
}

// Whether the node is in a face before this one that looks the same way.
static bool was_seen(const skin *s, int face_id, int node) {
    for (int i = 0; i < face_id; ++i) {
        const bool alike = dot(s->face[i].normal, s->face[face_id].normal) >= PARALLEL;
        for (int k = 0; k < 4 && alike; ++k) {
            if (s->face[i].node[k] == node) {
                return true;
            }
        }
    }
    return false;
}

// Of a node of the first body's face. Not found: nothing lies across.
static pm_status make_pair(const skin skins[2], int face_id, int corner, pm_contact_pair *pair,
                           bool *found) {
    const face *f = &skins[0].face[face_id];
    const double *at = f->corner[corner];
    double none = 0;
    *pair = (pm_contact_pair){0};
    set_frame(pair, f);
    PM_TRY(find_point(&skins[1], pair, -1, at, &pair->point[1], &pair->gap, found));
    if (*found) {
        PM_TRY(find_point(&skins[0], pair, 1, at, &pair->point[0], &none, found));
    }
    if (*found) {
        share_slopes(skins, pair);
    }
    return PM_OK;
}

pm_status pm_contact_pairs_find(pm_contact_pairs *facing, const pm_placed *first,
                                const pm_placed *second, pm_arena *arena) {
    skin skins[2];
    PM_TRY(find_skin(&skins[0], first, arena));
    PM_TRY(find_skin(&skins[1], second, arena));
    facing->npair = 0;
    facing->pair = pm_arena_array(arena, 4 * (size_t)skins[0].count, sizeof *facing->pair);
    if (facing->pair == NULL) {
        return no_memory();
    }
    for (int i = 0; i < skins[0].count; ++i) {
        for (int k = 0; k < 4; ++k) {
            bool found = false;
            if (!was_seen(&skins[0], i, skins[0].face[i].node[k])) {
                PM_TRY(make_pair(skins, i, k, &facing->pair[facing->npair], &found));
            }
            facing->npair += found;
        }
    }
    return PM_OK;
}

void pm_contact_pairs_measure(const pm_contact_pairs *facing, int end, const pm_placed *body,
                              const double *u, double *value) {
    const double sign = end == 0 ? -1 : 1;
    const int n = facing->npair;
    for (int i = 0; i < n; ++i) {
        const pm_contact_pair *pair = &facing->pair[i];
        const pm_contact_point *point = &pair->point[end];
        for (int k = 0; k < point->nnode; ++k) {
            double world[3];
            to_world(body, u + 3 * (ptrdiff_t)point->node[k], world);
            const double along = dot(pair->normal, world);
            value[PM_CONTACT_GAP * n + i] += sign * point->value[k] * along;
            for (int t = 0; t < 2; ++t) {
                value[(PM_CONTACT_SLID_U + t) * n + i] -=
                    sign * point->value[k] * dot(pair->tangent[t], world);
                value[(PM_CONTACT_SLOPE_U + t) * n + i] +=
                    point->share[t] * point->slope[t][k] * along;
            }
        }
    }
}

void pm_contact_pairs_add_forces(const pm_contact_pairs *facing, int end, const pm_placed *body,
                                 const double *effort, double *f) {
    const double sign = end == 0 ? -1 : 1;
    const int n = facing->npair;
    for (int i = 0; i < n; ++i) {
        const pm_contact_pair *pair = &facing->pair[i];
        const pm_contact_point *point = &pair->point[end];
        for (int k = 0; k < point->nnode; ++k) {
            double along = -sign * point->value[k] * effort[PM_CONTACT_GAP * n + i];
            double world[3] = {0};
            for (int t = 0; t < 2; ++t) {
                const double slid =
                    sign * point->value[k] * effort[(PM_CONTACT_SLID_U + t) * n + i];
                along -=
                    point->share[t] * point->slope[t][k] * effort[(PM_CONTACT_SLOPE_U + t) * n + i];
                for (int d = 0; d < 3; ++d) {
                    world[d] += slid * pair->tangent[t][d];
                }
            }
            for (int d = 0; d < 3; ++d) {
                world[d] += along * pair->normal[d];
            }
            for (int d = 0; d < 3; ++d) {
                f[3 * (ptrdiff_t)point->node[k] + d] += dot(body->axis[d], world);
            }
        }
    }
}
