// Parts of file names.
#ifndef PM_BASE_PATH_H
#define PM_BASE_PATH_H

#include <stddef.h>

// Returns the number of bytes before the path's ending: 8 for "runs.d/a.h5". The whole path counts
// where the name has no ending, as in "runs.d/a" and "runs.d/.h5".
size_t pm_path_stem(const char *path);

#endif
