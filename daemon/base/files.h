// A program does not overwrite a file that it reads. The readers note each file, by its device and
// inode, and the writers ask before they create one. Safe with threads.
#ifndef PM_BASE_FILES_H
#define PM_BASE_FILES_H

#include <stdbool.h>
#include <stdio.h>

#include "base/status.h"

// Notes that the program reads this file, unless it has written the file itself.
void pm_files_note_input(const char *path);
// Notes that the program has written this file, so that it may read and write it again.
void pm_files_note_output(const char *path);

// PM_EUSAGE: the program reads the file at `path`. PM_EFILE: with `regular`, there is something at
// `path` that is no regular file, such as a device.
pm_status pm_files_check_output(const char *path, bool regular);

// Creates a text file, which the caller closes. PM_EUSAGE: the program reads it. PM_EFILE.
pm_status pm_files_create(FILE **file, const char *path);

#endif
