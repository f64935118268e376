// Checkpoints as attributes `format`, `kind`, `digest` and one dataset per field.
#include "store/checkpoint.h"

#include <inttypes.h>
#include <string.h>

#include "store/hdf5_io.h"

#define FORMAT "portmet checkpoint 1"

static pm_status save(pm_hdf5 *file, const char *kind, uint64_t digest, int nfield,
                      const pm_checkpoint_field *field) {
    PM_TRY(pm_hdf5_write_text(file, "/", "format", FORMAT));
    PM_TRY(pm_hdf5_write_text(file, "/", "kind", kind));
    PM_TRY(pm_hdf5_write_integer(file, "/", "digest", digest));
    for (int i = 0; i < nfield; ++i) {
        PM_TRY(pm_hdf5_write(file, field[i].name, 1, &field[i].count, field[i].value));
    }
    return pm_hdf5_commit(file);
}

pm_status pm_checkpoint_save(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field) {
    pm_hdf5 *file = NULL;
    PM_TRY(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    const pm_status status = save(file, kind, digest, nfield, field);
    pm_hdf5_close(file);
    return status;
}

static pm_status load(pm_hdf5 *file, pm_arena *arena, const char *path, const char *kind,
                      uint64_t digest, int nfield, const pm_checkpoint_field *field) {
    const char *format = NULL, *found_kind = NULL;
    uint64_t found = 0;
    PM_TRY(pm_hdf5_read_text(file, "/", "format", arena, &format));
    if (strcmp(format, FORMAT) != 0) {
        return pm_fail(PM_EFILE, "%s: format \"%s\", expected \"%s\"", path, format, FORMAT);
    }
    PM_TRY(pm_hdf5_read_text(file, "/", "kind", arena, &found_kind));
    PM_TRY(pm_hdf5_read_integer(file, "/", "digest", &found));
    if (strcmp(found_kind, kind) != 0 || found != digest) {
        return pm_fail(PM_EFILE,
                       "%s: a checkpoint of %s %016" PRIx64 ", expected %s %016" PRIx64
                       ": the configuration or the data have changed",
                       path, found_kind, found, kind, digest);
    }
    for (int i = 0; i < nfield; ++i) {
        PM_TRY(pm_hdf5_read(file, field[i].name, 1, &field[i].count, field[i].value));
    }
    return PM_OK;
}

pm_status pm_checkpoint_load(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field) {
    pm_hdf5 *file = NULL;
    pm_arena arena = {0};
    PM_TRY(pm_hdf5_open(&file, path, PM_HDF5_OWN, PM_EFILE));
    const pm_status status = load(file, &arena, path, kind, digest, nfield, field);
    pm_hdf5_close(file);
    pm_arena_free(&arena);
    return status;
}
