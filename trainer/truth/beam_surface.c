// Computes the weights of a smooth side: cubics along u and v, and parabolas beyond the edges.
#include "truth/beam_surface.h"

#include <math.h>

// The radius of the bends where they begin, relative to the thickness of a layer.
static const double roundness = 0.1;

pm_beam_surface pm_beam_surface_make(const pm_beam_mesh *mesh, int body, int axis, bool high) {
    const int across = 3 - axis, row = mesh->count[0] + 1;
    const int stride[3] = {1, row, row * (mesh->count[1] + 1)};
    const int first = body * (mesh->nnode / mesh->nbody);
    pm_beam_surface surface = {
        .first = first + (high ? mesh->count[axis] * stride[axis] : 0),
        .stride = {1, stride[across], high ? -stride[axis] : stride[axis]},
        .count = {mesh->count[0], mesh->count[across]},
        .side = (high ? 1 : -1) * (axis == 2 ? 1 : -1), // x cross y is z, x cross z is -y
    };
    const int along[3] = {0, across, axis};
    for (int d = 0; d < 3; ++d) {
        surface.step[d] = mesh->size[along[d]] / mesh->count[along[d]];
    }
    return surface;
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

// The weights of a Catmull-Rom cubic at the fraction t between the second and the third node.
static void weigh_cubic(double t, line_weights *l) {
    const double w[3][4] = {
        {((2 - t) * t - 1) * t / 2, ((3 * t - 5) * t * t + 2) / 2, ((4 - 3 * t) * t + 1) * t / 2,
         (t - 1) * t * t / 2},
        {((4 - 3 * t) * t - 1) / 2, (9 * t - 10) * t / 2, ((8 - 9 * t) * t + 1) / 2,
         (3 * t - 2) * t / 2},
        {2 - 3 * t, 9 * t - 5, 4 - 9 * t, 3 * t - 1},
    };
    for (int d = 0; d < 3; ++d) {
        for (int i = 0; i < 4; ++i) {
            l->weight[d][i] = w[d][i];
        }
    }
}

// Returns the weights along a line of `count` elements at u, which may lie beyond its ends.
static line_weights weigh_line(double u, int count) {
    const int cell = (int)fmin(fmax(floor(u), 0), count - 1);
    const double inside = fmin(fmax(u, 0), count), beyond = u - inside;
    line_weights l = {.first = cell - 1};
    weigh_cubic(inside - cell, &l);
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

// Computes the derivatives by u and v of the product of a and b.
static void multiply(const double *a, const double *b, double *ab) {
    ab[PM_VALUE] = a[PM_VALUE] * b[PM_VALUE];
    ab[PM_BY_U] = a[PM_BY_U] * b[PM_VALUE] + a[PM_VALUE] * b[PM_BY_U];
    ab[PM_BY_V] = a[PM_BY_V] * b[PM_VALUE] + a[PM_VALUE] * b[PM_BY_V];
    ab[PM_BY_UU] =
        a[PM_BY_UU] * b[PM_VALUE] + 2 * a[PM_BY_U] * b[PM_BY_U] + a[PM_VALUE] * b[PM_BY_UU];
    ab[PM_BY_UV] = a[PM_BY_UV] * b[PM_VALUE] + a[PM_BY_U] * b[PM_BY_V] + a[PM_BY_V] * b[PM_BY_U] +
                   a[PM_VALUE] * b[PM_BY_UV];
    ab[PM_BY_VV] =
        a[PM_BY_VV] * b[PM_VALUE] + 2 * a[PM_BY_V] * b[PM_BY_V] + a[PM_VALUE] * b[PM_BY_VV];
}

// Adds the nodes of a layer, which has the weight `level` at the point.
static void add_layer(const pm_beam_surface *surface, int layer, const line_weights *along,
                      const line_weights *across, const double *level,
                      pm_beam_surface_weights *weights) {
    // The orders of the derivatives by u and v for each of PM_SURFACE_DERIVATIVES.
    static const int by[PM_SURFACE_DERIVATIVES][2] = {{0, 0}, {1, 0}, {0, 1},
                                                      {2, 0}, {1, 1}, {0, 2}};
    for (int m = 0; m < 16; ++m) {
        const int i = along->first + m % 4, j = across->first + m / 4, n = weights->nnode;
        double plane[PM_SURFACE_DERIVATIVES], weight[PM_SURFACE_DERIVATIVES];
        if (i < 0 || j < 0 || i > surface->count[0] || j > surface->count[1]) {
            continue;
        }
        for (int d = 0; d < PM_SURFACE_DERIVATIVES; ++d) {
            plane[d] = along->weight[by[d][0]][m % 4] * across->weight[by[d][1]][m / 4];
        }
        multiply(plane, level, weight);
        for (int d = 0; d < PM_SURFACE_DERIVATIVES; ++d) {
            weights->weight[d][n] = weight[d];
        }
        weights->node[n] = pm_beam_surface_node(surface, i, j, layer);
        ++weights->nnode;
    }
}

void pm_beam_surface_weigh(const pm_beam_surface *surface, double u, double v,
                           pm_beam_surface_weights *weights) {
    const line_weights along = weigh_line(u, surface->count[0]),
                       across = weigh_line(v, surface->count[1]);
    const double scale = 1 / (roundness * surface->step[2] * surface->step[2]);
    double by_u[3], by_v[3], top[PM_SURFACE_DERIVATIVES], below[PM_SURFACE_DERIVATIVES];
    bend(u, surface->count[0], scale * surface->step[0] * surface->step[0], by_u);
    bend(v, surface->count[1], scale * surface->step[1] * surface->step[1], by_v);
    below[PM_VALUE] = by_u[0] + by_v[0];
    below[PM_BY_U] = by_u[1];
    below[PM_BY_V] = by_v[1];
    below[PM_BY_UU] = by_u[2];
    below[PM_BY_UV] = 0;
    below[PM_BY_VV] = by_v[2];
    for (int d = 0; d < PM_SURFACE_DERIVATIVES; ++d) {
        top[d] = (d == PM_VALUE) - below[d];
    }
    weights->nnode = 0;
    add_layer(surface, 0, &along, &across, top, weights);
    if (below[PM_VALUE] > 0) {
        add_layer(surface, 1, &along, &across, below, weights);
    }
}
