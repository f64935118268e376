// Finds sides that face each other and closest points, and differentiates the penalty energy. Let
// r(y, x) be the vector from the surface's point at x = (u, v) to the node. It is a sum of the
// positions y with weights c(x): 1 for the node, and minus the weights of the surface. With
// F = |r|^2 / 2, the smallest F over x, called G, has the derivatives
//     dG/dy = F_y,   d2G/dy2 = F_yy - F_yx F_xx^-1 F_xy
#include "truth/beam_contact.h"

#include <math.h>

// --- candidates ---

// Returns the global axis along which two bodies lie apart while their projections along it
// overlap; -1: there is none. `above` tells whether the second body lies higher on that axis.
static int separation_axis(const pm_beam_mesh *mesh, int a, int b, bool *above) {
    double low[2][3], high[2][3];
    int axis = -1, apart = 0;
    pm_beam_mesh_bounds(mesh, a, low[0], high[0]);
    pm_beam_mesh_bounds(mesh, b, low[1], high[1]);
    for (int d = 0; d < 3; ++d) {
        if (low[1][d] >= high[0][d] || low[0][d] >= high[1][d]) {
            axis = d;
            *above = low[1][d] >= high[0][d];
            ++apart;
        }
    }
    return apart == 1 ? axis : -1;
}

// Finds the side of a body whose outward normal points along a global axis, upwards or downwards.
// Returns false if that is an end of the body.
static bool find_side(const pm_beam_mesh *mesh, int body, int axis, bool up,
                      pm_beam_surface *surface) {
    const pm_beam_placement *placement = &mesh->placement[body];
    for (int d = 1; d < 3; ++d) {
        if (placement->axis[d] == axis) {
            *surface = pm_beam_surface_make(mesh, body, d, (placement->sign[d] > 0) == up);
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
                (pm_beam_candidate){.node = pm_beam_surface_node(side, i, j, 0),
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
    if (contact->candidate == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    for (int a = 0; a < mesh->nbody; ++a) {
        for (int b = a + 1; b < mesh->nbody; ++b) {
            bool above = false;
            pm_beam_surface first, second;
            const int axis = separation_axis(mesh, a, b, &above);
            if (axis >= 0 && find_side(mesh, a, axis, above, &first) &&
                find_side(mesh, b, axis, !above, &second)) {
                add_side(contact, &first, &second);
                add_side(contact, &second, &first);
            }
        }
    }
    return PM_OK;
}

// --- the closest point ---

// A point of a candidate's surface, and the vector r from there to the node.
typedef struct surface_point {
    double u, v;
    pm_beam_surface_weights weights;
    double r[PM_SURFACE_DERIVATIVES][3]; // m, r and its derivatives by u and v
    double slope[2];                     // F_x
    double curvature[3];                 // F_xx: uu, uv, vv
} surface_point;

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Evaluates the point at g->u, g->v.
static void evaluate(const pm_beam_candidate *candidate, const double *q, surface_point *g) {
    double(*r)[3] = g->r;
    pm_beam_surface_weigh(&candidate->surface, g->u, g->v, &g->weights);
    for (int m = 0; m < PM_SURFACE_DERIVATIVES; ++m) {
        for (int d = 0; d < 3; ++d) {
            r[m][d] = m == PM_VALUE ? q[3 * candidate->node + d] : 0;
            for (int i = 0; i < g->weights.nnode; ++i) {
                r[m][d] -= g->weights.weight[m][i] * q[3 * g->weights.node[i] + d];
            }
        }
    }
    g->slope[0] = dot(r[PM_VALUE], r[PM_BY_U]);
    g->slope[1] = dot(r[PM_VALUE], r[PM_BY_V]);
    g->curvature[0] = dot(r[PM_BY_U], r[PM_BY_U]) + dot(r[PM_VALUE], r[PM_BY_UU]);
    g->curvature[1] = dot(r[PM_BY_U], r[PM_BY_V]) + dot(r[PM_VALUE], r[PM_BY_UV]);
    g->curvature[2] = dot(r[PM_BY_V], r[PM_BY_V]) + dot(r[PM_VALUE], r[PM_BY_VV]);
}

// Starts at the node of the surface that is closest to the candidate.
static void start(const pm_beam_candidate *candidate, const double *q, surface_point *g) {
    const pm_beam_surface *surface = &candidate->surface;
    double least = INFINITY;
    for (int j = 0; j <= surface->count[1]; ++j) {
        for (int i = 0; i <= surface->count[0]; ++i) {
            const double *x = q + 3 * pm_beam_surface_node(surface, i, j, 0);
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
}

// Returns true if u lies at most half an element beyond the edges, where the surface has bent far
// below them.
static bool lies_within(double u, int count) {
    return u > -0.5 && u < count + 0.5;
}

// Finds the closest point by Newton's method for u and v, in steps of at most one element. Returns
// false if the surface has no closest point.
static bool project(const pm_beam_candidate *candidate, const double *q, surface_point *g) {
    const double found = 1e-9; // a step this short leaves an error of its square
    const int most = 30;
    start(candidate, q, g);
    for (int k = 0; k < most; ++k) {
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
        if (size < found) {
            evaluate(candidate, q, g);
            return lies_within(g->u, candidate->surface.count[0]) &&
                   lies_within(g->v, candidate->surface.count[1]);
        }
    }
    return false;
}

// --- the response ---

// Returns true if the node lies behind the surface, r . normal < 0 with the outward normal, and no
// deeper than one layer of elements; a deeper node lies on another side of the body.
static bool lies_behind(const pm_beam_surface *surface, const surface_point *g) {
    const double *a = g->r[PM_BY_U], *b = g->r[PM_BY_V], *r = g->r[PM_VALUE];
    const double normal[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                              a[0] * b[1] - a[1] * b[0]};
    return surface->side * dot(r, normal) < 0 && dot(r, r) < surface->step[2] * surface->step[2];
}

// The weights c of the nodes and their derivatives by u and v; the candidate is the first node.
typedef struct contact_weights {
    double c[3][PM_BEAM_CONTACT_NODES];
} contact_weights;

// Lists the nodes of a contact and their weights.
static contact_weights gather(const pm_beam_candidate *candidate, const surface_point *g,
                              pm_beam_contact_force *force) {
    contact_weights w = {{{1}}};
    force->nnode = 1 + g->weights.nnode;
    force->node[0] = candidate->node;
    for (int i = 1; i < force->nnode; ++i) {
        force->node[i] = g->weights.node[i - 1];
        for (int m = 0; m < 3; ++m) { // PM_VALUE, PM_BY_U, PM_BY_V
            w.c[m][i] = -g->weights.weight[m][i - 1];
        }
    }
    return w;
}

// Computes the stiffness, `scale` times d2G/dy2 or its positive semi-definite part.
static void set_stiffness(double scale, bool exact, const surface_point *g,
                          const contact_weights *w, pm_beam_contact_force *force) {
    const int n = 3 * force->nnode;
    const double *a = g->r[PM_BY_U], *b = g->r[PM_BY_V];
    const double metric[3] = {dot(a, a), dot(a, b), dot(b, b)};
    const double *c = exact ? g->curvature : metric, det = c[0] * c[2] - c[1] * c[1];
    double F[2][3 * PM_BEAM_CONTACT_NODES], side[2][3 * PM_BEAM_CONTACT_NODES];
    for (int i = 0; i < n; ++i) {
        for (int x = 0; x < 2; ++x) {
            F[x][i] = w->c[PM_VALUE][i / 3] * g->r[1 + x][i % 3] +
                      (exact ? w->c[1 + x][i / 3] * g->r[PM_VALUE][i % 3] : 0);
        }
        side[0][i] = (c[2] * F[0][i] - c[1] * F[1][i]) / det;
        side[1][i] = (c[0] * F[1][i] - c[1] * F[0][i]) / det;
    }
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
            const double same = i % 3 == j % 3 ? w->c[PM_VALUE][i / 3] * w->c[PM_VALUE][j / 3] : 0;
            force->stiffness[n * i + j] =
                scale * (same - F[0][i] * side[0][j] - F[1][i] * side[1][j]);
        }
    }
}

bool pm_beam_contact_respond(const pm_beam_contact *contact, const pm_beam_candidate *candidate,
                             const double *q, bool exact, pm_beam_contact_force *force) {
    surface_point g;
    if (!project(candidate, q, &g) || !lies_behind(&candidate->surface, &g)) {
        return false;
    }
    const double scale = contact->stiffness * candidate->area / 2, *r = g.r[PM_VALUE];
    const contact_weights w = gather(candidate, &g, force);
    force->depth = sqrt(dot(r, r));
    force->energy = scale * dot(r, r) / 2;
    for (int i = 0; i < force->nnode; ++i) {
        for (int d = 0; d < 3; ++d) {
            force->force[i][d] = -scale * w.c[PM_VALUE][i] * r[d];
        }
    }
    set_stiffness(scale, exact, &g, &w, force);
    return true;
}
