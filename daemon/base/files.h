// A program does not overwrite a file that it reads. The readers note each file, by its device and
// inode, and the writers ask before they create one. Safe with threads.
#ifndef PM_BASE_FILES_H
#define PM_BASE_FILES_H

#include <stdbool.h>
#include <stdio.h>

#include "base/status.h"

// PM_EFILE: there is something at `path` that is neither a file nor a folder, such as a pipe, for
// which a reader might wait without end.
pm_status pm_files_check_input(const char *path);
// Notes that the program reads this file, unless it has written the file itself.
void pm_files_note_input(const char *path);
// Notes that the program has written this file, so that it may read and write it again.
void pm_files_note_output(const char *path);

// A kind of file: the bytes with which each begins. PM_FILES_ANY: any regular file. Weights and
// recordings are HDF5 files whose first attribute is their kind; PM_FILES_HDF5 is any other one.
// The files of pictures, whatever their format, have these words among their first bytes.
#define PM_FILES_ANY ""
#define PM_FILES_HDF5 "\x89HDF\r\n\x1a\n"
#define PM_FILES_WEIGHTS "portmet weights"
#define PM_FILES_RECORDING "portmet recording"
#define PM_FILES_ARCHIVE "PK"
#define PM_FILES_PICTURE "#: of a picture by portmet"

// Checks that the program may write to `path`. PM_EUSAGE: it also reads this file. PM_EFILE: `path`
// is no regular file, such as a device, or a file of another kind than `kind`, which the program
// cannot have written. A symbolic link is refused wherever it leads: some writers would replace the
// link, others would write to its end, which may be a device. An empty file is of every kind. With
// kind == NULL only PM_EUSAGE is checked.
pm_status pm_files_check_output(const char *path, const char *kind);

// Creates a text file, or one of a kind, which the caller closes. Fails as pm_files_check_output
// does. PM_EFILE.
pm_status pm_files_create(FILE **file, const char *path, const char *kind);

#endif
