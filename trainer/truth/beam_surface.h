// A smooth surface through the nodes on one side of a body. It consists of piecewise cubics
// (Catmull, Rom, 1974), is straight beyond the outermost nodes, and is once continuously
// differentiable. Beyond its edges it bends into the body along parabolas, so that a node that
// slides over an edge does not gain or lose contact abruptly. Every point is a sum over nodes with
// weights that depend on the surface coordinates u and v alone and sum to 1. Flat sides therefore
// stay flat, and at the place of a node its own weight is 1.
#ifndef PM_TRAINER_TRUTH_BEAM_SURFACE_H
#define PM_TRAINER_TRUTH_BEAM_SURFACE_H

#include "truth/beam_mesh.h"

typedef struct pm_beam_surface {
    int first;      // node at u = v = 0
    int stride[3];  // between neighbouring nodes along u (the body's x), along v, and inwards
    int count[2];   // elements along u and v
    double step[3]; // m, undeformed distance of nodes along u, along v, and inwards
    double side;    // 1 or -1, such that side dx/du x dx/dv points out of the body
} pm_beam_surface;

// Returns the side of a body normal to its `axis` (1: y, 2: z), at the top (`high`) or at 0.
pm_beam_surface pm_beam_surface_make(const pm_beam_mesh *mesh, int body, int axis, bool high);

// Returns the node at indices i along u and j along v, k layers below the surface.
static inline int pm_beam_surface_node(const pm_beam_surface *surface, int i, int j, int k) {
    return surface->first + i * surface->stride[0] + j * surface->stride[1] +
           k * surface->stride[2];
}

enum { PM_VALUE, PM_BY_U, PM_BY_V, PM_BY_UU, PM_BY_UV, PM_BY_VV, PM_SURFACE_DERIVATIVES };
#define PM_BEAM_SURFACE_NODES 32

// The weights of a point and their derivatives by u and v.
typedef struct pm_beam_surface_weights {
    int nnode;
    int node[PM_BEAM_SURFACE_NODES];
    double weight[PM_SURFACE_DERIVATIVES][PM_BEAM_SURFACE_NODES];
} pm_beam_surface_weights;

// Computes the weights at u, v, which are 0 and `count` at the outermost nodes; points beyond them
// are allowed.
void pm_beam_surface_weigh(const pm_beam_surface *surface, double u, double v,
                           pm_beam_surface_weights *weights);

#endif
