// Any bytes must read as a trajectory of fields on a mesh, or be refused with a one-line error.
// Only bytes that pass store/hdf5_check.h are tried: field.c opens other files in a child process,
// since the HDF5 library crashes on some of them.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bodies/field/field.h"
#include "bytes_file.h"
#include "store/hdf5_io.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(int holds) {
    if (!holds) {
        abort();
    }
}

static void check_finite(const double *value, size_t count) {
    for (size_t i = 0; value != NULL && i < count; ++i) {
        check(isfinite(value[i]));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *const path = PM_FUZZ_FILE;
    pm_field *field = NULL;
    bytes_file(data, size);
    if (!pm_hdf5_is_own(path)) {
        return 0;
    }
    if (pm_field_load(&field, path) != PM_OK) {
        check(field == NULL && pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL);
        return 0;
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
    return 0;
}
