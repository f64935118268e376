// Any bytes must read as a mesh and as a trajectory of fields on one, or be refused with a one-line
// error.
// Only bytes that pass store/hdf5_check.h are tried: field.c opens other files in a child process,
// since the HDF5 library crashes on some of them.
#include <math.h>
#include <string.h>

#include "bodies/field/field.h"
#include "bytes_file.h"
#include "store/hdf5_io.h"
#include "store/solid_mesh.h"
#include "tests/fuzz/target.h"

static void check_finite(const double *value, size_t count) {
    for (size_t i = 0; value != NULL && i < count; ++i) {
        check(isfinite(value[i]));
    }
}

static void try_mesh(const char *path) {
    pm_arena arena = {0};
    pm_solid_mesh mesh = {0};
    if (pm_solid_mesh_load(&mesh, path, &arena) != PM_OK) {
        check(mesh.position == NULL && pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL);
    }
    check_finite(mesh.position, 3 * (size_t)mesh.nnode);
    for (int i = 0; i < PM_BRICK_NODES * mesh.nelement; ++i) {
        check(mesh.brick[i] >= 0 && mesh.brick[i] < mesh.nnode);
    }
    for (int i = 0; i < mesh.ncontact; ++i) {
        check(mesh.contact[i] >= 0 && mesh.contact[i] < mesh.nnode);
    }
    pm_arena_free(&arena);
}

static void try_field(const char *path) {
    pm_field *field = NULL;
    if (pm_field_load(&field, path) != PM_OK) {
        check(field == NULL && pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL);
        return;
    }
    const size_t times = (size_t)field->ntrajectory * (size_t)field->ntime;
    const size_t nodes = times * (size_t)field->nnode;
    check_finite(field->z, nodes * (size_t)field->nvariable);
    check_finite(field->f, 3 * nodes);
    check_finite(field->contact, 3 * nodes);
    check_finite(field->position, 3 * (size_t)field->nnode);
    check_finite(field->t, (size_t)field->ntime);
    check_finite(field->energy, times * PM_FIELD_ENERGIES);
    check(field->dt > 0);
    for (size_t i = 0; i < 8 * (size_t)field->nelement; ++i) {
        check(field->hexahedron[i] >= 0 && field->hexahedron[i] < field->nnode);
    }
    pm_field_free(field);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    bytes_file(data, size);
    if (pm_hdf5_is_own(PM_FUZZ_FILE)) {
        try_mesh(PM_FUZZ_FILE);
        try_field(PM_FUZZ_FILE);
    }
    return 0;
}
