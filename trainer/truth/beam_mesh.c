// Makes the nodes and bricks of boxes.
#include "truth/beam_mesh.h"

#include <math.h>

// The grid offsets of a brick's corners from its first corner.
static const int corner[PM_BEAM_CORNERS][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                               {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};

// Computes the undeformed positions of a body's nodes.
static void place_nodes(pm_beam_mesh *mesh, const pm_beam_placement *placement,
                        double (*position)[3]) {
    for (int k = 0; k <= mesh->count[2]; ++k) {
        for (int j = 0; j <= mesh->count[1]; ++j) {
            for (int i = 0; i <= mesh->count[0]; ++i) {
                const int index[3] = {i, j, k};
                double own[3], *x = position[pm_beam_mesh_node(mesh, i, j, k)];
                for (int d = 0; d < 3; ++d) {
                    own[d] = mesh->size[d] * index[d] / mesh->count[d];
                }
                pm_beam_placement_turn(placement, own, x);
                for (int d = 0; d < 3; ++d) {
                    x[d] += placement->origin[d];
                }
            }
        }
    }
}

// Lists the nodes of the elements of a body whose nodes begin at `first`.
static void connect(const pm_beam_mesh *mesh, int first, int *node) {
    for (int k = 0; k < mesh->count[2]; ++k) {
        for (int j = 0; j < mesh->count[1]; ++j) {
            for (int i = 0; i < mesh->count[0]; ++i) {
                for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
                    *node++ = first + pm_beam_mesh_node(mesh, i + corner[c][0], j + corner[c][1],
                                                        k + corner[c][2]);
                }
            }
        }
    }
}

pm_status pm_beam_mesh_place(pm_beam_mesh *mesh, const int count[3], const double size[3],
                             int nbody, const pm_beam_placement *placement, pm_arena *arena) {
    int nnode = 1, nelement = 1;
    *mesh = (pm_beam_mesh){.nbody = nbody};
    for (int d = 0; d < 3; ++d) {
        mesh->count[d] = count[d];
        mesh->size[d] = size[d];
        nnode *= count[d] + 1;
        nelement *= count[d];
    }
    mesh->nnode = nbody * nnode;
    mesh->nelement = nbody * nelement;
    mesh->placement = pm_arena_array(arena, (size_t)nbody, sizeof *mesh->placement);
    mesh->position = pm_arena_array(arena, (size_t)mesh->nnode, sizeof *mesh->position);
    mesh->hexahedron = pm_arena_array(arena, (size_t)mesh->nelement, sizeof *mesh->hexahedron);
    if (mesh->placement == NULL || mesh->position == NULL || mesh->hexahedron == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    for (int b = 0; b < nbody; ++b) {
        mesh->placement[b] = placement[b];
        place_nodes(mesh, &placement[b], mesh->position + b * nnode);
        connect(mesh, b * nnode, mesh->hexahedron[b * nelement]);
    }
    return PM_OK;
}

pm_status pm_beam_mesh_make(pm_beam_mesh *mesh, const int count[3], const double size[3],
                            pm_arena *arena) {
    const pm_beam_placement identity = {.axis = {0, 1, 2}, .sign = {1, 1, 1}};
    return pm_beam_mesh_place(mesh, count, size, 1, &identity, arena);
}

void pm_beam_mesh_bounds(const pm_beam_mesh *mesh, int body, double low[3], double high[3]) {
    const pm_beam_placement *placement = &mesh->placement[body];
    double extent[3];
    pm_beam_placement_turn(placement, mesh->size, extent);
    for (int d = 0; d < 3; ++d) {
        low[d] = placement->origin[d] + fmin(extent[d], 0);
        high[d] = placement->origin[d] + fmax(extent[d], 0);
    }
}
