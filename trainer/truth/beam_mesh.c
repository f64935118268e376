// Makes the nodes and bricks of boxes, and reads those of other bodies.
#include "truth/beam_mesh.h"

#include <math.h>
#include <string.h>

#include "store/solid_mesh.h"

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

static pm_status make_arrays(pm_beam_mesh *mesh, pm_arena *arena) {
    const size_t nnode = (size_t)mesh->nnode;
    mesh->placement = pm_arena_array(arena, (size_t)mesh->nbody, sizeof *mesh->placement);
    mesh->position = pm_arena_array(arena, nnode, sizeof *mesh->position);
    mesh->hexahedron = pm_arena_array(arena, (size_t)mesh->nelement, sizeof *mesh->hexahedron);
    mesh->clamped = pm_arena_array(arena, nnode, sizeof *mesh->clamped);
    return mesh->placement == NULL || mesh->position == NULL || mesh->hexahedron == NULL ||
                   mesh->clamped == NULL
               ? pm_fail(PM_ENOMEM, "beam: out of memory")
               : PM_OK;
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
    mesh->edge = size[0] / count[0];
    PM_TRY(make_arrays(mesh, arena));
    for (int b = 0; b < nbody; ++b) {
        mesh->placement[b] = placement[b];
        place_nodes(mesh, &placement[b], mesh->position + b * nnode);
        connect(mesh, b * nnode, mesh->hexahedron[b * nelement]);
    }
    for (int i = 0; i < mesh->nnode; ++i) {
        mesh->clamped[i] = i % (count[0] + 1) == 0;
    }
    return PM_OK;
}

static const pm_beam_placement identity = {.axis = {0, 1, 2}, .sign = {1, 1, 1}};

pm_status pm_beam_mesh_make(pm_beam_mesh *mesh, const int count[3], const double size[3],
                            pm_arena *arena) {
    return pm_beam_mesh_place(mesh, count, size, 1, &identity, arena);
}

// Computes the size of the box around all nodes, and the length of an edge.
static void measure(pm_beam_mesh *mesh) {
    const double *a = mesh->position[mesh->hexahedron[0][0]],
                 *b = mesh->position[mesh->hexahedron[0][1]];
    double square = 0;
    for (int d = 0; d < 3; ++d) {
        double low = a[d], high = a[d];
        for (int i = 0; i < mesh->nnode; ++i) {
            low = fmin(low, mesh->position[i][d]);
            high = fmax(high, mesh->position[i][d]);
        }
        mesh->size[d] = high - low;
        square += (a[d] - b[d]) * (a[d] - b[d]);
    }
    mesh->edge = sqrt(square);
}

pm_status pm_beam_mesh_load(pm_beam_mesh *mesh, const char *path, pm_arena *arena) {
    pm_solid_mesh file;
    int nclamped = 0;
    PM_TRY(pm_solid_mesh_load(&file, path, arena));
    *mesh = (pm_beam_mesh){.nbody = 1, .nnode = file.nnode, .nelement = file.nelement};
    PM_TRY(make_arrays(mesh, arena));
    mesh->placement[0] = identity;
    memcpy(mesh->position, file.position, (size_t)file.nnode * sizeof *mesh->position);
    memcpy(mesh->hexahedron, file.brick, (size_t)file.nelement * sizeof *mesh->hexahedron);
    for (int i = 0; i < file.nnode; ++i) {
        mesh->clamped[i] = file.clamped[i];
        nclamped += file.clamped[i];
    }
    measure(mesh);
    return nclamped > 0 && nclamped < file.nnode
               ? PM_OK
               : pm_fail(PM_EDATA, "%s: %d of %d nodes are clamped, expected some, but not all",
                         path, nclamped, file.nnode);
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
