// Finds sides that face each other and closest points, and differentiates the penalty energy. Let
// r(y, x) be the vector from the surface's point at x = (u, v) to the node. It is a sum of the
// positions y with weights c(x): 1 for the node, and minus the weights of the surface. With
// F = |r|^2 / 2, the smallest F over x, called G, has the derivatives
//     dG/dy = F_y,   d2G/dy2 = F_yy - F_yx F_xx^-1 F_xy
#include "bodies/truth/beam_contact.h"

#include <math.h>

// The radius of a rounded edge at its beginning, relative to the thickness of a layer.
#define ROUNDNESS 0.1
// The search for the closest point ends when u and v move by less than this, in elements. The error
// that is left is the square of it.
#define FOUND 1e-9
#define MAX_ITERATIONS 30
// How far beyond the edges a closest point may lie, in elements. The surface has bent far below
// them.
#define MAX_BEYOND 0.5

enum { SURFACE_NODES = PM_BEAM_CONTACT_NODES - 1 };

// A point of a surface: its value and its derivatives.
enum { VALUE, BY_U, BY_V, BY_UU, BY_UV, BY_VV, DERIVATIVES };

// The weights of a point and their derivatives by u and v.
typedef struct surface_weights {
    int nnode;
    int node[SURFACE_NODES];
    double weight[DERIVATIVES][SURFACE_NODES];
} surface_weights;

// --- the surface ---

// Returns the node at indices i along u and j along v, k layers below the surface.
static int surface_node(const pm_beam_surface *surface, int i, int j, int k) {
    return surface->first + i * surface->stride[0] + j * surface->stride[1] +
           k * surface->stride[2];
}

// The weights of four nodes from `first` on along a line, and their first and second derivatives.
typedef struct line_weights {
    int first;
    double weight[3][4];
} line_weights;

// Distributes the weight of a node `ghost` that lies on the straight line through the two beside
// it.
static void fold(line_weights *l, int ghost, int near, int next) {
    for (int d = 0; d < 3; ++d) {
        l->weight[d][near] += 2 * l->weight[d][ghost];
        l->weight[d][next] -= l->weight[d][ghost];
        l->weight[d][ghost] = 0;
    }
}

// Returns the weights along a line of `count` elements at u, which may lie beyond its ends.
static line_weights weigh_line(double u, int count) {
    const int cell = (int)fmin(fmax(floor(u), 0), count - 1);
    const double inside = fmin(fmax(u, 0), count), beyond = u - inside, t = inside - cell;
    // A Catmull-Rom cubic at the fraction t between the second and the third node.
    line_weights l = {cell - 1,
                      {{((2 - t) * t - 1) * t / 2, ((3 * t - 5) * t * t + 2) / 2,
                        ((4 - 3 * t) * t + 1) * t / 2, (t - 1) * t * t / 2},
                       {((4 - 3 * t) * t - 1) / 2, (9 * t - 10) * t / 2, ((8 - 9 * t) * t + 1) / 2,
                        (3 * t - 2) * t / 2},
                       {2 - 3 * t, 9 * t - 5, 4 - 9 * t, 3 * t - 1}}};
    if (cell == 0) {
        fold(&l, 0, 1, 2);
    }
    if (cell == count - 1) {
        fold(&l, 3, 2, 1);
    }
    for (int i = 0; i < 4 && beyond != 0; ++i) {
        l.weight[0][i] += beyond * l.weight[1][i];
        l.weight[2][i] = 0;
    }
    return l;
}

// Computes scale/2 times the square of the distance of u beyond an edge, and its derivatives by u.
static void bend(double u, int count, double scale, double result[3]) {
    const double beyond = u - fmin(fmax(u, 0), count);
    result[0] = scale * beyond * beyond / 2;
    result[1] = scale * beyond;
    result[2] = beyond != 0 ? scale : 0;
}

// Adds the nodes of a layer, which has the weight `level` at the point.
static void add_layer(const pm_beam_surface *surface, int layer, const line_weights *along,
                      const line_weights *across, const double *level, surface_weights *weights) {
    // Each derivative is taken so often by u and so often by v.
    static const int by[DERIVATIVES][2] = {{0, 0}, {1, 0}, {0, 1}, {2, 0}, {1, 1}, {0, 2}};
    for (int m = 0; m < 16; ++m) {
        const int i = along->first + m % 4, j = across->first + m / 4, n = weights->nnode;
        double plane[DERIVATIVES], weight[DERIVATIVES];
        if (i < 0 || j < 0 || i > surface->count[0] || j > surface->count[1]) {
            continue;
        }
        for (int d = 0; d < DERIVATIVES; ++d) {
            plane[d] = along->weight[by[d][0]][m % 4] * across->weight[by[d][1]][m / 4];
        }
        // The derivatives of the product of both.
        const double *a = plane, *b = level;
        weight[VALUE] = a[VALUE] * b[VALUE];
        weight[BY_U] = a[BY_U] * b[VALUE] + a[VALUE] * b[BY_U];
        weight[BY_V] = a[BY_V] * b[VALUE] + a[VALUE] * b[BY_V];
        weight[BY_UU] = a[BY_UU] * b[VALUE] + 2 * a[BY_U] * b[BY_U] + a[VALUE] * b[BY_UU];
        weight[BY_UV] =
            a[BY_UV] * b[VALUE] + a[BY_U] * b[BY_V] + a[BY_V] * b[BY_U] + a[VALUE] * b[BY_UV];
        weight[BY_VV] = a[BY_VV] * b[VALUE] + 2 * a[BY_V] * b[BY_V] + a[VALUE] * b[BY_VV];
        for (int d = 0; d < DERIVATIVES; ++d) {
            weights->weight[d][n] = weight[d];
        }
        weights->node[n] = surface_node(surface, i, j, layer);
        ++weights->nnode;
    }
}

// Computes the weights at u, v, which are 0 and `count` at the outermost nodes; points beyond them
// are allowed.
static void weigh_surface(const pm_beam_surface *surface, double u, double v,
                          surface_weights *weights) {
    const line_weights along = weigh_line(u, surface->count[0]),
                       across = weigh_line(v, surface->count[1]);
    const double scale = 1 / (ROUNDNESS * surface->step[2] * surface->step[2]);
    double by_u[3], by_v[3], top[DERIVATIVES], below[DERIVATIVES];
    bend(u, surface->count[0], scale * surface->step[0] * surface->step[0], by_u);
    bend(v, surface->count[1], scale * surface->step[1] * surface->step[1], by_v);
    below[VALUE] = by_u[0] + by_v[0];
    below[BY_U] = by_u[1];
    below[BY_V] = by_v[1];
    below[BY_UU] = by_u[2];
    below[BY_UV] = 0;
    below[BY_VV] = by_v[2];
    for (int d = 0; d < DERIVATIVES; ++d) {
        top[d] = (d == VALUE) - below[d];
    }
    weights->nnode = 0;
    add_layer(surface, 0, &along, &across, top, weights);
    if (below[VALUE] > 0) {
        add_layer(surface, 1, &along, &across, below, weights);
    }
}

// --- candidates ---

// Finds the side of a body whose outward normal points along a global axis, upwards or downwards.
// Returns false if that is an end of the body.
static bool find_side(const pm_beam_mesh *mesh, int body, int axis, bool up,
                      pm_beam_surface *surface) {
    const pm_placement *placement = &mesh->placement[body];
    for (int d = 1; d < 3; ++d) {
        if (placement->axis[d] == axis) {
            const bool high = (placement->sign[d] > 0) == up; // the side at the top, or at 0
            const int across = 3 - d, row = mesh->count[0] + 1, along[3] = {0, across, d};
            const int stride[3] = {1, row, row * (mesh->count[1] + 1)};
            const int first = body * (mesh->nnode / mesh->nbody);
            *surface = (pm_beam_surface){
                .first = first + (high ? mesh->count[d] * stride[d] : 0),
                .stride = {1, stride[across], high ? -stride[d] : stride[d]},
                .count = {mesh->count[0], mesh->count[across]},
                .side = (high ? 1 : -1) * (d == 2 ? 1 : -1), // x cross y is z, x cross z is -y
            };
            for (int e = 0; e < 3; ++e) {
                surface->step[e] = mesh->size[along[e]] / mesh->count[along[e]];
            }
            return true;
        }
    }
    return false;
}

// Adds the nodes of a side as candidates for contact with the other side.
static void add_side(pm_beam_contact *contact, const pm_beam_surface *side,
                     const pm_beam_surface *other) {
    for (int j = 0; j <= side->count[1]; ++j) {
        for (int i = 0; i <= side->count[0]; ++i) {
            const double share =
                (i % side->count[0] == 0 ? 0.5 : 1) * (j % side->count[1] == 0 ? 0.5 : 1);
            contact->candidate[contact->ncandidate++] =
                (pm_beam_candidate){.node = surface_node(side, i, j, 0),
                                    .area = share * side->step[0] * side->step[1],
                                    .surface = *other};
        }
    }
}

pm_status pm_beam_contact_make(pm_beam_contact *contact, const pm_beam_mesh *mesh, double stiffness,
                               pm_arena *arena) {
    const int widest = mesh->count[1] > mesh->count[2] ? mesh->count[1] : mesh->count[2];
    const int npair = mesh->nbody * (mesh->nbody - 1) / 2;
    const int capacity = npair * 2 * (mesh->count[0] + 1) * (widest + 1);
    *contact = (pm_beam_contact){.stiffness = stiffness};
    contact->candidate = pm_arena_array(arena, (size_t)capacity, sizeof *contact->candidate);
    PM_TRY(pm_arena_status(arena, "the contact of beams"));
    for (int k = 0; k < mesh->nbody * mesh->nbody; ++k) {
        const int a = k / mesh->nbody, b = k % mesh->nbody;
        if (a >= b) {
            continue;
        }
        // The global axis along which the bodies lie apart while their projections along it
        // overlap.
        double low[2][3], high[2][3];
        int axis = 0, apart = 0;
        bool above = false; // the second body lies higher on that axis
        pm_beam_mesh_bounds(mesh, a, low[0], high[0]);
        pm_beam_mesh_bounds(mesh, b, low[1], high[1]);
        for (int d = 0; d < 3; ++d) {
            if (low[1][d] >= high[0][d] || low[0][d] >= high[1][d]) {
                axis = d;
                above = low[1][d] >= high[0][d];
                ++apart;
            }
        }
        pm_beam_surface first, second;
        if (apart == 1 && find_side(mesh, a, axis, above, &first) &&
            find_side(mesh, b, axis, !above, &second)) {
            add_side(contact, &first, &second);
            add_side(contact, &second, &first);
        }
    }
    return PM_OK;
}

// --- the closest point ---

// A point of a candidate's surface, and the vector r from there to the node.
typedef struct surface_point {
    double u, v;
    surface_weights weights;
    double r[DERIVATIVES][3]; // m, r and its derivatives by u and v
    double slope[2];          // F_x
    double curvature[3];      // F_xx: uu, uv, vv
} surface_point;

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Evaluates the point at g->u, g->v.
static void evaluate(const pm_beam_candidate *candidate, const double *q, surface_point *g) {
    double(*r)[3] = g->r;
    weigh_surface(&candidate->surface, g->u, g->v, &g->weights);
    for (int m = 0; m < DERIVATIVES; ++m) {
        for (int d = 0; d < 3; ++d) {
            r[m][d] = m == VALUE ? q[3 * candidate->node + d] : 0;
            for (int i = 0; i < g->weights.nnode; ++i) {
                r[m][d] -= g->weights.weight[m][i] * q[3 * g->weights.node[i] + d];
            }
        }
    }
    g->slope[0] = dot(r[VALUE], r[BY_U]);
    g->slope[1] = dot(r[VALUE], r[BY_V]);
    g->curvature[0] = dot(r[BY_U], r[BY_U]) + dot(r[VALUE], r[BY_UU]);
    g->curvature[1] = dot(r[BY_U], r[BY_V]) + dot(r[VALUE], r[BY_UV]);
    g->curvature[2] = dot(r[BY_V], r[BY_V]) + dot(r[VALUE], r[BY_VV]);
}

// Finds the closest point by Newton's method for u and v, in steps of at most one element, from the
// node of the surface that is closest to the candidate. Returns false if the surface has no closest
// point.
static bool project(const pm_beam_candidate *candidate, const double *q, surface_point *g) {
    const pm_beam_surface *surface = &candidate->surface;
    double least = INFINITY;
    for (int j = 0; j <= surface->count[1]; ++j) {
        for (int i = 0; i <= surface->count[0]; ++i) {
            const double *x = q + 3 * surface_node(surface, i, j, 0);
            double square = 0;
            for (int d = 0; d < 3; ++d) {
                square += pow(q[3 * candidate->node + d] - x[d], 2);
            }
            if (square < least) {
                least = square;
                g->u = i;
                g->v = j;
            }
        }
    }
    for (int k = 0; k < MAX_ITERATIONS; ++k) {
        evaluate(candidate, q, g);
        const double *c = g->curvature, *s = g->slope, det = c[0] * c[2] - c[1] * c[1];
        if (!(c[0] > 0 && det > 0)) {
            return false;
        }
        const double du = (c[1] * s[1] - c[2] * s[0]) / det;
        const double dv = (c[1] * s[0] - c[0] * s[1]) / det;
        const double size = fmax(fabs(du), fabs(dv)), part = size > 1 ? 1 / size : 1;
        g->u += part * du;
        g->v += part * dv;
        if (size < FOUND) {
            evaluate(candidate, q, g);
            return g->u > -MAX_BEYOND && g->u < surface->count[0] + MAX_BEYOND &&
                   g->v > -MAX_BEYOND && g->v < surface->count[1] + MAX_BEYOND;
        }
    }
    return false;
}

// --- the response ---

// The weights c of the nodes and their derivatives by u and v; the candidate is the first node.
typedef struct contact_weights {
    double c[3][PM_BEAM_CONTACT_NODES];
} contact_weights;

// Computes the stiffness, `scale` times d2G/dy2 or its positive semi-definite part.
static void set_stiffness(double scale, bool exact, const surface_point *g,
                          const contact_weights *w, pm_beam_contact_force *force) {
    const int n = 3 * force->nnode;
    const double *a = g->r[BY_U], *b = g->r[BY_V];
    const double metric[3] = {dot(a, a), dot(a, b), dot(b, b)};
    const double *c = exact ? g->curvature : metric, det = c[0] * c[2] - c[1] * c[1];
    double F[2][3 * PM_BEAM_CONTACT_NODES], side[2][3 * PM_BEAM_CONTACT_NODES];
    for (int i = 0; i < n; ++i) {
        for (int x = 0; x < 2; ++x) {
            F[x][i] = w->c[VALUE][i / 3] * g->r[1 + x][i % 3] +
                      (exact ? w->c[1 + x][i / 3] * g->r[VALUE][i % 3] : 0);
        }
        side[0][i] = (c[2] * F[0][i] - c[1] * F[1][i]) / det;
        side[1][i] = (c[0] * F[1][i] - c[1] * F[0][i]) / det;
    }
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
            const double same = i % 3 == j % 3 ? w->c[VALUE][i / 3] * w->c[VALUE][j / 3] : 0;
            force->stiffness[n * i + j] =
                scale * (same - F[0][i] * side[0][j] - F[1][i] * side[1][j]);
        }
    }
}

bool pm_beam_contact_respond(const pm_beam_contact *contact, const pm_beam_candidate *candidate,
                             const double *q, bool exact, pm_beam_contact_force *force) {
    const pm_beam_surface *surface = &candidate->surface;
    surface_point g;
    if (!project(candidate, q, &g)) {
        return false;
    }
    // The node must lie behind the surface, r . normal < 0 with the outward normal, and no deeper
    // than one layer of elements; a deeper node lies on another side of the body.
    const double *a = g.r[BY_U], *b = g.r[BY_V], *r = g.r[VALUE];
    const double normal[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                              a[0] * b[1] - a[1] * b[0]};
    if (!(surface->side * dot(r, normal) < 0 && dot(r, r) < surface->step[2] * surface->step[2])) {
        return false;
    }
    const double scale = contact->stiffness * candidate->area / 2;
    contact_weights w = {{{1}}};
    force->nnode = 1 + g.weights.nnode;
    force->node[0] = candidate->node;
    for (int i = 1; i < force->nnode; ++i) {
        force->node[i] = g.weights.node[i - 1];
        for (int m = VALUE; m <= BY_V; ++m) {
            w.c[m][i] = -g.weights.weight[m][i - 1];
        }
    }
    force->depth = sqrt(dot(r, r));
    force->energy = scale * dot(r, r) / 2;
    for (int i = 0; i < force->nnode; ++i) {
        for (int d = 0; d < 3; ++d) {
            force->force[i][d] = -scale * w.c[VALUE][i] * r[d];
        }
    }
    set_stiffness(scale, exact, &g, &w, force);
    return true;
}
