// A snapshot is a file of numbers from which a program resumes after it was killed. Saving replaces
// the file atomically. Loading refuses a snapshot of other inputs or of another process. The
// numbers have the byte order and format of the machine. The file holds a header (format, digest,
// layout, session, count, owner), the numbers, and a digest of both.
#ifndef PM_STORE_SNAPSHOT_H
#define PM_STORE_SNAPSHOT_H

#include <stdbool.h>
#include <stdint.h>

#include "base/status.h"

#define PM_SNAPSHOT_OWNER 256

// The key of a snapshot identifies the inputs and the list of numbers. A file with another key is
// refused.
typedef struct pm_snapshot_key {
    uint64_t digest; // of the inputs: scene, weights and initial state, or a training and its data
    uint64_t layout; // of the names and counts of the numbers (pm_serializer)
    int count;       // of the numbers
    // Names the process, or the kind of work, to which the numbers belong; borrowed. Names that
    // agree in their first PM_SNAPSHOT_OWNER - 1 bytes count as the same.
    const char *owner;
} pm_snapshot_key;

// Replaces the file at `path` by value [count]; `session` tells runs of the same inputs apart. The
// function allocates no memory and does not wait for the disk: the snapshot survives the death of
// the process, but not of the host. PM_EFILE.
pm_status pm_snapshot_save(const char *path, const pm_snapshot_key *key, int64_t session,
                           const double *value);

// Reads `session` and value [count]. Where there is no file, `found` is false. On failure the
// results stay untouched. PM_EFILE: truncated, damaged, not finite, or of another key; PM_ENOMEM.
pm_status pm_snapshot_load(const char *path, const pm_snapshot_key *key, int64_t *session,
                           double *value, bool *found);

// Reads only the session. Where there is no file, `found` is false. PM_EFILE: the file is not a
// snapshot, or has another digest or owner.
pm_status pm_snapshot_session(const char *path, const pm_snapshot_key *key, int64_t *session,
                              bool *found);

// --- checkpoints ---
//
// Checkpoints of work that takes hours, such as a training. A checkpoint holds named vectors of
// numbers. It is a snapshot that is synchronised with the disk before the call returns.

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
