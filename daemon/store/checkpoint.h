// Checkpoints of work that takes hours, such as a training. A checkpoint holds named vectors of
// numbers. It is a snapshot (snapshot.h) that is synchronised with the disk before the call
// returns.
#ifndef PM_STORE_CHECKPOINT_H
#define PM_STORE_CHECKPOINT_H

#include <stdint.h>

#include "base/status.h"

typedef struct pm_checkpoint_field {
    const char *name;
    int count;     // >= 1
    double *value; // [count]
} pm_checkpoint_field;

// Replaces the file at `path`. `kind` names the work, such as "fit"; `digest` is the digest of its
// configuration and data. PM_EFILE, PM_ENOMEM.
pm_status pm_checkpoint_save(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field);

// Reads the file into the fields, which stay untouched on failure. PM_EFILE: missing, damaged, or
// of another kind, digest, or list of fields; PM_ENOMEM.
pm_status pm_checkpoint_load(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field);

#endif
