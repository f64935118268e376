// Parts of file names.
#ifndef PM_BASE_PATH_H
#define PM_BASE_PATH_H

#include <stddef.h>

// Returns the length in bytes of a path without its file extension: 8 for "runs.d/a.h5". It is the
// length of the whole path if the name has no extension, as in "runs.d/a" and "runs.d/.h5".
size_t pm_path_stem(const char *path);

// Returns `path` as seen from the folder of the file `from`: "../a.h5". Both folders must exist. It
// is written to `out` [PATH_MAX], and is absolute where they share no folder but "/".
const char *pm_path_seen_from(const char *from, const char *path, char *out);

// Writes the name of the folder that holds the file `path` to `out` [size]: letters and digits,
// with
// '_' in place of every other character, and the last of them where there are too many. A name that
// would not begin with a letter gets `prefix` and '_' before it; if the folder has no name with a
// letter or digit, the name is `prefix`. The folder must exist; `size` must exceed the length of
// `prefix` by 3.
void pm_path_folder_name(const char *path, const char *prefix, char *out, size_t size);

#endif
