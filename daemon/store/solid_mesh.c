// Loads, saves and digests meshes.
#include "store/solid_mesh.h"

#include <math.h>

#include "base/digest.h"
#include "store/hdf5_io.h"

#define POSITION "/node_position_reference"
#define BRICKS "/hexahedra"
#define CLAMPED "/clamped"
#define CONTACT "/contact"

static pm_status no_memory(const char *path) {
    return pm_fail(PM_ENOMEM, "%s: out of memory for a mesh", path);
}

// Converts numbers of nodes, and checks that there are such nodes. `what` [each] numbers form an
// entry.
static pm_status to_nodes(const char *path, const pm_solid_mesh *mesh, const char *what,
                          size_t each, size_t count, const double *number, int *node) {
    for (size_t i = 0; i < count; ++i) {
        if (!(number[i] >= 0 && number[i] < mesh->nnode && number[i] == floor(number[i]))) {
            return pm_fail(PM_EDATA, "%s: %s %zu: node %g, expected a number below %d", path, what,
                           i / each, number[i], mesh->nnode);
        }
        node[i] = (int)number[i];
    }
    return PM_OK;
}

// Reads the bricks.
static pm_status read_bricks(const pm_hdf5 *file, const char *path, pm_arena *arena,
                             pm_solid_mesh *mesh) {
    int extent[2];
    PM_TRY(pm_hdf5_shape(file, BRICKS, 2, extent));
    if (extent[1] != PM_BRICK_NODES) {
        return pm_fail(PM_EDATA, "%s: elements of %d nodes, expected %d", path, extent[1],
                       PM_BRICK_NODES);
    }
    const size_t count = (size_t)extent[0] * PM_BRICK_NODES;
    double *number = pm_arena_array(arena, count, sizeof *number);
    int *brick = pm_arena_array(arena, count, sizeof *brick);
    PM_TRY(number == NULL || brick == NULL ? no_memory(path) : PM_OK);
    PM_TRY(pm_hdf5_read(file, BRICKS, 2, extent, number));
    PM_TRY(to_nodes(path, mesh, "element", PM_BRICK_NODES, count, number, brick));
    mesh->nelement = extent[0];
    mesh->brick = brick;
    return PM_OK;
}

// Reads the nodes of the contact; a mesh without them has none.
static pm_status read_contact(const pm_hdf5 *file, const char *path, pm_arena *arena,
                              pm_solid_mesh *mesh) {
    int count;
    if (!pm_hdf5_has(file, CONTACT)) {
        return PM_OK;
    }
    PM_TRY(pm_hdf5_shape(file, CONTACT, 1, &count));
    double *number = pm_arena_array(arena, (size_t)count, sizeof *number);
    int *node = pm_arena_array(arena, (size_t)count, sizeof *node);
    PM_TRY(number == NULL || node == NULL ? no_memory(path) : PM_OK);
    PM_TRY(pm_hdf5_read(file, CONTACT, 1, &count, number));
    PM_TRY(to_nodes(path, mesh, "contact", 1, (size_t)count, number, node));
    mesh->ncontact = count;
    mesh->contact = node;
    return PM_OK;
}

static pm_status read_nodes(const pm_hdf5 *file, const char *path, pm_arena *arena,
                            pm_solid_mesh *mesh) {
    int extent[2];
    PM_TRY(pm_hdf5_shape(file, POSITION, 2, extent));
    if (extent[1] != 3) {
        return pm_fail(PM_EDATA, "%s: nodes have %d coordinates, expected 3", path, extent[1]);
    }
    const size_t nnode = (size_t)extent[0];
    double *position = pm_arena_array(arena, 3 * nnode, sizeof *position);
    double *number = pm_arena_array(arena, nnode, sizeof *number);
    bool *clamped = pm_arena_array(arena, nnode, sizeof *clamped);
    PM_TRY(position == NULL || number == NULL || clamped == NULL ? no_memory(path) : PM_OK);
    PM_TRY(pm_hdf5_read(file, POSITION, 2, extent, position));
    PM_TRY(pm_hdf5_read(file, CLAMPED, 1, extent, number));
    for (size_t i = 0; i < 3 * nnode; ++i) {
        if (!isfinite(position[i])) {
            return pm_fail(PM_EDATA, "%s: node %zu has no finite position", path, i / 3);
        }
    }
    for (size_t i = 0; i < nnode; ++i) {
        clamped[i] = number[i] != 0;
    }
    *mesh = (pm_solid_mesh){.nnode = extent[0], .position = position, .clamped = clamped};
    return PM_OK;
}

pm_status pm_solid_mesh_load(pm_solid_mesh *mesh, const char *path, pm_arena *arena) {
    pm_hdf5 *file = NULL;
    pm_solid_mesh loaded;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA));
    PM_TRY_DONE(read_nodes(file, path, arena, &loaded));
    PM_TRY_DONE(read_bricks(file, path, arena, &loaded));
    PM_TRY_DONE(read_contact(file, path, arena, &loaded));
    *mesh = loaded;
done:
    pm_hdf5_close(file);
    return status;
}

static pm_status write(pm_hdf5 *file, const pm_solid_mesh *mesh, double *number) {
    const int nodes[2] = {mesh->nnode, 3}, bricks[2] = {mesh->nelement, PM_BRICK_NODES};
    PM_TRY(pm_hdf5_write(file, POSITION, 2, nodes, mesh->position));
    for (int i = 0; i < mesh->nnode; ++i) {
        number[i] = mesh->clamped[i];
    }
    PM_TRY(pm_hdf5_write(file, CLAMPED, 1, nodes, number));
    for (int i = 0; i < PM_BRICK_NODES * mesh->nelement; ++i) {
        number[i] = mesh->brick[i];
    }
    PM_TRY(pm_hdf5_write(file, BRICKS, 2, bricks, number));
    for (int i = 0; i < mesh->ncontact; ++i) {
        number[i] = mesh->contact[i];
    }
    if (mesh->ncontact > 0) {
        PM_TRY(pm_hdf5_write(file, CONTACT, 1, &mesh->ncontact, number));
    }
    return pm_hdf5_commit(file);
}

pm_status pm_solid_mesh_save(const pm_solid_mesh *mesh, const char *path) {
    pm_arena arena = {0};
    pm_hdf5 *file = NULL;
    pm_status status;
    double *number = pm_arena_array(
        &arena, (size_t)mesh->nnode + PM_BRICK_NODES * (size_t)mesh->nelement, sizeof *number);
    PM_TRY_DONE(number == NULL ? no_memory(path) : PM_OK);
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    status = write(file, mesh, number);
done:
    pm_hdf5_close(file);
    pm_arena_free(&arena);
    return status;
}

uint64_t pm_solid_mesh_digest(const pm_solid_mesh *mesh, uint64_t digest) {
    digest = pm_digest_integer(digest, mesh->nnode);
    digest = pm_digest_doubles(digest, mesh->position, 3 * (size_t)mesh->nnode);
    for (int i = 0; i < mesh->nnode; ++i) {
        digest = pm_digest_integer(digest, mesh->clamped[i]);
    }
    for (int i = 0; i < PM_BRICK_NODES * mesh->nelement; ++i) {
        digest = pm_digest_integer(digest, mesh->brick[i]);
    }
    for (int i = 0; i < mesh->ncontact; ++i) {
        digest = pm_digest_integer(digest, mesh->contact[i]);
    }
    return digest;
}
