// Loads, saves and digests meshes.
#include "store/solid_mesh.h"

#include <math.h>

#include "base/digest.h"
#include "store/hdf5_io.h"

#define POSITION "/node_position_reference"
#define BRICKS "/hexahedra"
#define CLAMPED "/clamped"
#define CONTACT "/contact"

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

static pm_status read_content(const pm_hdf5 *file, const char *path, pm_arena *arena,
                              pm_solid_mesh *mesh) {
    int nodes[2], bricks[2], ncontact = 0;
    PM_TRY(pm_hdf5_shape(file, POSITION, 2, nodes));
    if (nodes[1] != 3) {
        return pm_fail(PM_EDATA, "%s: nodes have %d coordinates, expected 3", path, nodes[1]);
    }
    PM_TRY(pm_hdf5_shape(file, BRICKS, 2, bricks));
    if (bricks[1] != PM_BRICK_NODES) {
        return pm_fail(PM_EDATA, "%s: elements of %d nodes, expected %d", path, bricks[1],
                       PM_BRICK_NODES);
    }
    const bool touches = pm_hdf5_has(file, CONTACT); // a mesh without such nodes has no contact
    PM_TRY(touches ? pm_hdf5_shape(file, CONTACT, 1, &ncontact) : PM_OK);
    const size_t nnode = (size_t)nodes[0], nbrick = (size_t)bricks[0] * PM_BRICK_NODES;
    const size_t most = nnode + nbrick + (size_t)ncontact;
    double *number = pm_arena_array(arena, most, sizeof *number);
    double *position = pm_arena_array(arena, 3 * nnode, sizeof *position);
    bool *clamped = pm_arena_array(arena, nnode, sizeof *clamped);
    int *brick = pm_arena_array(arena, nbrick, sizeof *brick);
    int *contact = pm_arena_array(arena, (size_t)ncontact, sizeof *contact);
    PM_TRY(pm_arena_status(arena, "a mesh"));
    *mesh = (pm_solid_mesh){
        nodes[0], bricks[0], position, brick, clamped, ncontact, touches ? contact : NULL};
    PM_TRY(pm_hdf5_read(file, POSITION, 2, nodes, position));
    for (size_t i = 0; i < 3 * nnode; ++i) {
        if (!isfinite(position[i])) {
            return pm_fail(PM_EDATA, "%s: node %zu has no finite position", path, i / 3);
        }
    }
    PM_TRY(pm_hdf5_read(file, CLAMPED, 1, nodes, number));
    for (size_t i = 0; i < nnode; ++i) {
        clamped[i] = number[i] != 0;
    }
    PM_TRY(pm_hdf5_read(file, BRICKS, 2, bricks, number));
    PM_TRY(to_nodes(path, mesh, "element", PM_BRICK_NODES, nbrick, number, brick));
    if (touches) {
        PM_TRY(pm_hdf5_read(file, CONTACT, 1, &ncontact, number));
        PM_TRY(to_nodes(path, mesh, "contact", 1, (size_t)ncontact, number, contact));
    }
    return PM_OK;
}

static pm_status load(pm_solid_mesh *mesh, const char *path, pm_arena *arena) {
    pm_hdf5 *file = NULL;
    pm_solid_mesh loaded;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA));
    PM_TRY_DONE(read_content(file, path, arena, &loaded));
    *mesh = loaded;
done:
    pm_hdf5_close(file);
    return status;
}

static void try_load(const void *path) {
    pm_arena arena = {0};
    pm_solid_mesh mesh;
    (void)load(&mesh, path, &arena);
    pm_arena_free(&arena);
}

pm_status pm_solid_mesh_load(pm_solid_mesh *mesh, const char *path, pm_arena *arena) {
    PM_TRY(pm_hdf5_try(path, try_load, path));
    return load(mesh, path, arena);
}

// Writes whole numbers or truths [count] of a mesh.
#define WRITE(NAME, RANK, EXTENT, COUNT, VALUE)                       \
    do {                                                              \
        for (int i = 0; i < (COUNT); ++i) {                           \
            number[i] = (VALUE)[i];                                   \
        }                                                             \
        PM_TRY_DONE(pm_hdf5_write(file, NAME, RANK, EXTENT, number)); \
    } while (0)

pm_status pm_solid_mesh_save(const pm_solid_mesh *mesh, const char *path) {
    pm_arena arena = {0};
    pm_hdf5 *file = NULL;
    pm_status status;
    const int nodes[2] = {mesh->nnode, 3}, bricks[2] = {mesh->nelement, PM_BRICK_NODES};
    double *number = pm_arena_array(
        &arena, (size_t)mesh->nnode + PM_BRICK_NODES * (size_t)mesh->nelement, sizeof *number);
    PM_TRY_DONE(pm_arena_status(&arena, "a mesh"));
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    PM_TRY_DONE(pm_hdf5_write(file, POSITION, 2, nodes, mesh->position));
    WRITE(CLAMPED, 1, nodes, mesh->nnode, mesh->clamped);
    WRITE(BRICKS, 2, bricks, PM_BRICK_NODES * mesh->nelement, mesh->brick);
    if (mesh->ncontact > 0) {
        WRITE(CONTACT, 1, &mesh->ncontact, mesh->ncontact, mesh->contact);
    }
    status = pm_hdf5_commit(file);
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
