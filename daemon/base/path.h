// Parts of file names.
#ifndef PM_BASE_PATH_H
#define PM_BASE_PATH_H

#include <stddef.h>

// Returns the length in bytes of a path without its file extension: 8 for "runs.d/a.h5". It is the
// length of the whole path if the name has no extension, as in "runs.d/a" and "runs.d/.h5".
size_t pm_path_stem(const char *path);

#endif
