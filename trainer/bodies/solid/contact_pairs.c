// Finds contact pairs face by face, and maps between displacements and the quantities of the pairs.
#include "bodies/solid/contact_pairs.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define PARALLEL 0.999  // cosine above which two normals count as equal
#define TOLERANCE 1e-6  // relative to the size of a face
#define NEWTON_STEPS 10 // each doubles the digits: to rounding with room to spare

// A face of a body's surface in its place.
typedef struct contact_face {
    int node[4];
    double corner[4][3]; // m, in the global frame
    double normal[3];    // unit, outwards, in the global frame
    double size;         // m
} contact_face;

typedef struct contact_side {
    int nface;
    contact_face *face; // [nface]
} contact_side;

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

// Divides a vector by its length, which is returned.
static double make_unit(double *a) {
    const double length = sqrt(dot(a, a));
    for (int d = 0; d < 3; ++d) {
        a[d] /= length;
    }
    return length;
}

// --- the surface of a body in its place ---
//
// The faces that belong to one element only: all faces of all elements are sorted, so that a face
// that two elements share stands beside its twin.

// A quadrangle; seen from outside its nodes run counterclockwise.
typedef struct surface_face {
    int node[4];
    int sorted[4]; // the same nodes in ascending order, which identify the face
} surface_face;

typedef struct surface {
    int nface;
    surface_face *face; // [nface], ordered by `sorted`
} surface;

static int compare_nodes(const void *a, const void *b) {
    return *(const int *)a - *(const int *)b;
}

static int compare_faces(const void *a, const void *b) {
    const surface_face *x = a, *y = b;
    for (int i = 0; i < 4; ++i) {
        if (x->sorted[i] != y->sorted[i]) {
            return x->sorted[i] - y->sorted[i];
        }
    }
    return 0;
}

// Finds the surface of `nelement` > 0 hexahedra [nelement][8], whose nodes are numbered as in VTK.
// Memory from the arena. PM_ENOMEM.
static pm_status find_surface(surface *found_surface, int nelement, const double *hexahedron,
                              pm_arena *arena) {
    static const int corner[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                     {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
    const size_t count = 6 * (size_t)nelement;
    surface_face *all = pm_arena_array(arena, count, sizeof *all);
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
    *found_surface = (surface){.nface = found, .face = all};
    return PM_OK;
}

static pm_status place_surface(contact_side *s, const pm_placed_body *body, pm_arena *arena) {
    surface own;
    if (body->nelement == 0) {
        return pm_fail(PM_EDATA, "%s: the basis has no mesh, whose sides could touch", body->name);
    }
    PM_TRY(find_surface(&own, body->nelement, body->hexahedron, arena));
    s->nface = own.nface;
    s->face = pm_arena_array(arena, (size_t)own.nface, sizeof *s->face);
    PM_TRY(pm_arena_status(arena, "the surface of a body"));
    for (int i = 0; i < own.nface; ++i) {
        contact_face *f = &s->face[i];
        double diagonal[2][3];
        memcpy(f->node, own.face[i].node, sizeof f->node);
        for (int k = 0; k < 4; ++k) {
            pm_placement_point(&body->placement, body->position + 3 * (ptrdiff_t)f->node[k],
                               f->corner[k]);
        }
        for (int d = 0; d < 3; ++d) {
            diagonal[0][d] = f->corner[2][d] - f->corner[0][d];
            diagonal[1][d] = f->corner[3][d] - f->corner[1][d];
        }
        cross(diagonal[0], diagonal[1], f->normal);
        f->size = sqrt(make_unit(f->normal));
    }
    return PM_OK;
}

// --- points of a surface ---

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

// Finds the point of the face with the tangential coordinates of `at` by Newton's method. Writes
// the weights of the face's corners there and their slopes along both tangents. Returns false if
// the point lies outside the face.
static bool locate_on_face(const contact_face *f, const pm_contact_pair *pair, const double *at,
                           double weight[4], double slope[2][4]) {
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

// Finds the point of a surface straight across from `at`, on the nearest of the faces whose normal
// is `sign` times that of the pair. Where several faces meet there the weights are their mean. If
// there is no such face, `found` becomes false.
static pm_status find_point(const contact_side *s, const pm_contact_pair *pair, double sign,
                            const double *at, pm_contact_point *point, double *distance,
                            bool *found) {
    double weight[4], slope[2][4];
    int nface = 0;
    *point = (pm_contact_point){0};
    for (int i = 0; i < s->nface; ++i) {
        const contact_face *f = &s->face[i];
        if (sign * dot(f->normal, pair->normal) < PARALLEL ||
            !locate_on_face(f, pair, at, weight, slope)) {
            continue;
        }
        double far = -dot(pair->normal, at); // distance along the normal of the pair
        for (int k = 0; k < 4; ++k) {
            far += weight[k] * dot(pair->normal, f->corner[k]);
        }
        const double close = TOLERANCE * f->size;
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
            int n = 0;
            while (n < point->nnode && point->node[n] != f->node[k]) {
                ++n;
            }
            if (n == PM_CONTACT_MOST_NODES) {
                return pm_fail(PM_EDATA, "the faces that meet at a point have more than %d nodes",
                               PM_CONTACT_MOST_NODES);
            }
            point->nnode = n == point->nnode ? n + 1 : point->nnode;
            point->node[n] = f->node[k];
            point->value[n] += weight[k];
            point->slope[0][n] += slope[0][k];
            point->slope[1][n] += slope[1][k];
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

// Returns the extent along a tangent, m, of the faces whose normal is `sign` times that of the
// pair.
static double length_of(const contact_side *s, const pm_contact_pair *pair, double sign,
                        int tangent) {
    double low = INFINITY, high = -INFINITY;
    for (int i = 0; i < s->nface; ++i) {
        for (int k = 0; k < 4 && sign * dot(s->face[i].normal, pair->normal) >= PARALLEL; ++k) {
            const double at = dot(pair->tangent[tangent], s->face[i].corner[k]);
            low = fmin(low, at);
            high = fmax(high, at);
        }
    }
    return high - low;
}

pm_status pm_contact_pairs_find(pm_contact_pairs *pairs, const pm_placed_body *first,
                                const pm_placed_body *second, pm_arena *arena) {
    contact_side sides[2];
    PM_TRY(place_surface(&sides[0], first, arena));
    PM_TRY(place_surface(&sides[1], second, arena));
    pairs->npair = 0;
    pairs->pair = pm_arena_array(arena, 4 * (size_t)sides[0].nface, sizeof *pairs->pair);
    PM_TRY(pm_arena_status(arena, "contact pairs"));
    for (int i = 0; i < 4 * sides[0].nface; ++i) {
        const contact_face *f = &sides[0].face[i / 4], *other = sides[0].face;
        pm_contact_pair *pair = &pairs->pair[pairs->npair];
        const double *at = f->corner[i % 4];
        double none = 0;
        bool seen = false, found = false;
        // An earlier face may have the node and the same normal.
        for (; other < f && !seen; ++other) {
            const bool alike = dot(other->normal, f->normal) >= PARALLEL;
            for (int k = 0; k < 4 && alike; ++k) {
                seen = seen || other->node[k] == f->node[i % 4];
            }
        }
        if (seen) {
            continue;
        }
        // The normal is that of the face, and the first tangent lies along its first edge.
        *pair = (pm_contact_pair){0};
        memcpy(pair->normal, f->normal, sizeof pair->normal);
        for (int d = 0; d < 3; ++d) {
            pair->tangent[0][d] = f->corner[1][d] - f->corner[0][d];
        }
        make_unit(pair->tangent[0]);
        cross(pair->normal, pair->tangent[0], pair->tangent[1]);
        PM_TRY(find_point(&sides[1], pair, -1, at, &pair->point[1], &pair->gap, &found));
        if (found) {
            PM_TRY(find_point(&sides[0], pair, 1, at, &pair->point[0], &none, &found));
        }
        // The slope is that of the longer side.
        for (int t = 0; t < 2 && found; ++t) {
            const double own = length_of(&sides[0], pair, 1, t);
            const double across = length_of(&sides[1], pair, -1, t);
            const bool equal = fabs(own - across) <= TOLERANCE * (own + across);
            pair->point[0].share[t] = equal ? 0.5 : own > across;
            pair->point[1].share[t] = 1 - pair->point[0].share[t];
        }
        pairs->npair += found;
    }
    return PM_OK;
}

void pm_contact_pairs_measure(const pm_contact_pairs *pairs, int end, const pm_placed_body *body,
                              const double *u, double *value) {
    const double sign = end == 0 ? -1 : 1;
    const int n = pairs->npair;
    for (int i = 0; i < n; ++i) {
        const pm_contact_pair *pair = &pairs->pair[i];
        const pm_contact_point *point = &pair->point[end];
        for (int k = 0; k < point->nnode; ++k) {
            double global[3];
            pm_placement_rotate(&body->placement, u + 3 * (ptrdiff_t)point->node[k], global);
            const double along = dot(pair->normal, global);
            value[PM_CONTACT_GAP * n + i] += sign * point->value[k] * along;
            for (int t = 0; t < 2; ++t) {
                value[(PM_CONTACT_SLID_U + t) * n + i] -=
                    sign * point->value[k] * dot(pair->tangent[t], global);
                value[(PM_CONTACT_SLOPE_U + t) * n + i] +=
                    point->share[t] * point->slope[t][k] * along;
            }
        }
    }
}

void pm_contact_pairs_add_forces(const pm_contact_pairs *pairs, int end, const pm_placed_body *body,
                                 const double *effort, double *f) {
    const double sign = end == 0 ? -1 : 1;
    const int n = pairs->npair;
    for (int i = 0; i < n; ++i) {
        const pm_contact_pair *pair = &pairs->pair[i];
        const pm_contact_point *point = &pair->point[end];
        for (int k = 0; k < point->nnode; ++k) {
            double along = -sign * point->value[k] * effort[PM_CONTACT_GAP * n + i];
            double force[3] = {0}, own[3];
            for (int t = 0; t < 2; ++t) {
                const double slid =
                    sign * point->value[k] * effort[(PM_CONTACT_SLID_U + t) * n + i];
                along -=
                    point->share[t] * point->slope[t][k] * effort[(PM_CONTACT_SLOPE_U + t) * n + i];
                for (int d = 0; d < 3; ++d) {
                    force[d] += slid * pair->tangent[t][d];
                }
            }
            for (int d = 0; d < 3; ++d) {
                force[d] += along * pair->normal[d];
            }
            pm_placement_rotate_back(&body->placement, force, own);
            for (int d = 0; d < 3; ++d) {
                f[3 * (ptrdiff_t)point->node[k] + d] += own[d];
            }
        }
    }
}
