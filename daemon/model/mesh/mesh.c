// Numbers the nodes and edges of a box of bricks and computes their features.
#include "model/mesh/mesh.h"

#include <math.h>
#include <stdbool.h>

// Finds the indices of node n along x, y, z.
static void place_of(const pm_mesh *m, int n, int at[3]) {
    at[0] = n % m->elements[0] + 1;
    at[1] = n / m->elements[0] % (m->elements[1] + 1);
    at[2] = n / m->elements[0] / (m->elements[1] + 1);
}

// Finds the source of the edge with direction d that leads to node n. False if there is none.
static bool source_of(const pm_mesh *m, int n, int d, int *source) {
    int at[3];
    place_of(m, n, at);
    const int axis = d / 2;
    at[axis] += d % 2 == 0 ? -1 : 1;
    if (at[axis] < (axis == 0 ? 1 : 0) || at[axis] > m->elements[axis]) {
        return false;
    }
    *source = pm_mesh_node(m, at);
    return true;
}

static pm_status check(const double size[3], const int elements[3]) {
    double nodes = elements[0];
    for (int c = 0; c < 3; ++c) {
        if (!(size[c] > 0) || elements[c] < 1) {
            return pm_fail(PM_ECONFIG, "mesh: sizes and elements must be positive");
        }
        nodes *= c > 0 ? elements[c] + 1.0 : 1;
    }
    return nodes <= PM_MESH_MOST_NODES
               ? PM_OK
               : pm_fail(PM_ECONFIG, "mesh: %.0f nodes, at most %d are possible", nodes,
                         PM_MESH_MOST_NODES);
}

pm_status pm_mesh_make(const double size[3], const int elements[3], pm_arena *arena,
                       const pm_mesh **mesh) {
    PM_TRY(check(size, elements));
    pm_mesh *m = pm_arena_alloc(arena, sizeof *m);
    const int nnode = elements[0] * (elements[1] + 1) * (elements[2] + 1);
    const size_t most = (size_t)nnode * PM_MESH_DIRECTIONS;
    int *source = pm_arena_array(arena, most, sizeof *source);
    int *target = pm_arena_array(arena, most, sizeof *target);
    int *direction = pm_arena_array(arena, most, sizeof *direction);
    if (m == NULL || source == NULL || target == NULL || direction == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a mesh");
    }
    *m = (pm_mesh){.nnode = nnode, .source = source, .target = target, .direction = direction};
    for (int c = 0; c < 3; ++c) {
        m->size[c] = size[c];
        m->elements[c] = elements[c];
    }
    for (int n = 0; n < nnode; ++n) {
        for (int d = 0; d < PM_MESH_DIRECTIONS; ++d) {
            if (source_of(m, n, d, &source[m->nedge])) {
                target[m->nedge] = n;
                direction[m->nedge++] = d;
            }
        }
    }
    *mesh = m;
    return PM_OK;
}

void pm_mesh_node_features(const pm_mesh *mesh, double *feature) {
    for (int n = 0; n < mesh->nnode; ++n, feature += PM_MESH_NODE_FEATURES) {
        int at[3];
        place_of(mesh, n, at);
        for (int c = 0; c < 3; ++c) {
            const bool last = at[c] == mesh->elements[c];
            feature[c] = 2.0 * at[c] / mesh->elements[c] - 1;
            feature[3 + c] = last || (c > 0 && at[c] == 0);
        }
    }
}

void pm_mesh_edge_features(const pm_mesh *mesh, double *feature) {
    double brick[3], longest = 0;
    for (int c = 0; c < 3; ++c) {
        brick[c] = mesh->size[c] / mesh->elements[c];
        longest = fmax(longest, brick[c]);
    }
    for (int d = 0; d < PM_MESH_DIRECTIONS; ++d, feature += PM_MESH_EDGE_FEATURES) {
        for (int c = 0; c < 3; ++c) {
            feature[c] = c != d / 2 ? 0 : d % 2 == 0 ? 1 : -1;
        }
        feature[3] = brick[d / 2] / longest;
    }
}
