// Names of files.
#ifndef PM_BASE_PATH_H
#define PM_BASE_PATH_H

#include <stddef.h>

// Bytes of the path before its ending: 8 of "runs.d/a.h5", all of "runs.d/a" and "runs.d/.h5".
size_t pm_path_stem(const char *path);

#endif
