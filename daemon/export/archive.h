// Writes a ZIP archive whose members are stored as they are (PKWARE, APPNOTE 6.3.3), which is what
// an FMU is.
#ifndef PM_EXPORT_ARCHIVE_H
#define PM_EXPORT_ARCHIVE_H

#include <stddef.h>
#include <stdio.h>

#include "base/arena.h"
#include "base/status.h"

typedef struct pm_archive_member pm_archive_member;

// The caller owns this storage, sets `file` and `arena`, which are borrowed, and initialises the
// rest with zeros.
typedef struct pm_archive {
    FILE *file;
    pm_arena *arena;
    int count;
    pm_archive_member *newest;
} pm_archive;

// Adds a member `bytes` [size] under `name`, of which the arena keeps a copy. PM_ENOMEM. PM_EFILE:
// the member or the archive is larger than 2 GiB. A failure to write sets ferror(archive->file),
// which the caller checks at the end.
pm_status pm_archive_add(pm_archive *archive, const char *name, const void *bytes, size_t size);
// Writes the directory with which the archive ends.
void pm_archive_finish(pm_archive *archive);

#endif
