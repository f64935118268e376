// Nodes and bricks of a box.
#include "truth/beam_mesh.h"

// Grid offsets of a brick's corners from its first.
static const int corner[PM_BEAM_CORNERS][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                               {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};

static void place_nodes(pm_beam_mesh *mesh) {
    for (int k = 0; k <= mesh->count[2]; ++k) {
        for (int j = 0; j <= mesh->count[1]; ++j) {
            for (int i = 0; i <= mesh->count[0]; ++i) {
                const int index[3] = {i, j, k};
                double *x = mesh->position[pm_beam_mesh_node(mesh, i, j, k)];
                for (int d = 0; d < 3; ++d) {
                    x[d] = mesh->size[d] * index[d] / mesh->count[d];
                }
            }
        }
    }
}

static void connect(pm_beam_mesh *mesh) {
    int *node = mesh->hexahedron[0];
    for (int k = 0; k < mesh->count[2]; ++k) {
        for (int j = 0; j < mesh->count[1]; ++j) {
            for (int i = 0; i < mesh->count[0]; ++i) {
                for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
                    *node++ = pm_beam_mesh_node(mesh, i + corner[c][0], j + corner[c][1],
                                                k + corner[c][2]);
                }
            }
        }
    }
}

pm_status pm_beam_mesh_make(pm_beam_mesh *mesh, const int count[3], const double size[3],
                            pm_arena *arena) {
    *mesh = (pm_beam_mesh){.nnode = 1, .nelement = 1};
    for (int d = 0; d < 3; ++d) {
        mesh->count[d] = count[d];
        mesh->size[d] = size[d];
        mesh->nnode *= count[d] + 1;
        mesh->nelement *= count[d];
    }
    mesh->position = pm_arena_array(arena, (size_t)mesh->nnode, sizeof *mesh->position);
    mesh->hexahedron = pm_arena_array(arena, (size_t)mesh->nelement, sizeof *mesh->hexahedron);
    if (mesh->position == NULL || mesh->hexahedron == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    place_nodes(mesh);
    connect(mesh);
    return PM_OK;
}
