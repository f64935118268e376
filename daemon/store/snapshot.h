// Snapshots: the numbers with which a process goes on after its death. Replaced in one piece, and
// they only open again for whom they were made. Written often and so never synced: a snapshot
// survives its process, not its host, and is read by the same program on the same kind of machine.
#ifndef PM_STORE_SNAPSHOT_H
#define PM_STORE_SNAPSHOT_H

#include <stdbool.h>
#include <stdint.h>

#include "base/status.h"

// `digest` says of what scene it is, `session` of which run. PM_EFILE, PM_ENOMEM.
pm_status pm_snapshot_save(const char *path, uint64_t digest, int64_t session, int count,
                           const double *value);

// Reads `session` and value [count]; untouched, with `found` false, where there is no file.
// PM_EFILE: truncated, damaged, not finite, of another digest or count; then, too, they are
// untouched.
pm_status pm_snapshot_load(const char *path, uint64_t digest, int64_t *session, int count,
                           double *value, bool *found);

// Only its session. PM_EFILE: not a snapshot, or of another digest.
pm_status pm_snapshot_session(const char *path, uint64_t digest, int64_t *session, bool *found);

#endif
