// Checkpoints: named vectors of numbers in an HDF5 file, replaced atomically, that only open again
// for whom they were made.
#ifndef PM_STORE_CHECKPOINT_H
#define PM_STORE_CHECKPOINT_H

#include <stdint.h>

#include "base/status.h"

typedef struct pm_checkpoint_field {
    const char *name;
    int count;     // >= 1
    double *value; // [count]
} pm_checkpoint_field;

// `kind` says what it is a checkpoint of, `digest` of which one exactly. PM_EFILE, PM_ENOMEM.
pm_status pm_checkpoint_save(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field);

// Fills the fields. PM_EFILE: missing, truncated, of another kind, digest or size. On failure the
// fields may be partly filled.
pm_status pm_checkpoint_load(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field);

#endif
