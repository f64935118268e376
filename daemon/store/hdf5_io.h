// HDF5 with errors turned into pm_status, for the layer store/ alone: the only door to the library.
// Files are hostile until checked: type, rank, extents, sizes and links are looked at before
// anything is read, and links to other files are not followed. Objects are named by absolute paths,
// "/" or
// "/parameters/energy.0.weight"; missing parents are made on writing.
//
// Failures: PM_EFILE if a file cannot be opened or written; the code given to pm_hdf5_open if its
// content is not what was asked for; PM_ENOMEM.
#ifndef PM_STORE_HDF5_IO_H
#define PM_STORE_HDF5_IO_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_HDF5_MAX_RANK 4

typedef struct pm_hdf5 pm_hdf5;

// --- files ---

// Where a file to be read comes from. OWN: pm_hdf5_create, and only what hdf5_check.h lets pass
// gets as far as the library, which crashes on many a damaged file. ANY: whatever the library can
// read.
typedef enum pm_hdf5_source { PM_HDF5_OWN, PM_HDF5_ANY } pm_hdf5_source;

// Opens for reading. `content` is the code of failures that lie in the content.
pm_status pm_hdf5_open(pm_hdf5 **file, const char *path, pm_hdf5_source source, pm_status content);
// Would OWN let it pass? Files that cannot be opened do not.
bool pm_hdf5_is_own(const char *path);

// Lets the library end, in a child process that tries whether it survives a file.
void pm_hdf5_end(void);

// Opens a file that was written in place, to go on writing. PM_EFILE.
pm_status pm_hdf5_reopen(pm_hdf5 **file, const char *path);

// ATOMIC: written under a temporary name in the same folder; appears at `path`, whole, on commit.
// IN_PLACE: written at `path` itself, so that what was flushed is there when the writer is killed.
typedef enum pm_hdf5_mode { PM_HDF5_ATOMIC, PM_HDF5_IN_PLACE } pm_hdf5_mode;
pm_status pm_hdf5_create(pm_hdf5 **file, const char *path, pm_hdf5_mode mode);
pm_status pm_hdf5_flush(pm_hdf5 *file);
// Closes the file, syncs and renames an ATOMIC one. pm_hdf5_close must still follow.
pm_status pm_hdf5_commit(pm_hdf5 *file);
// Frees; an ATOMIC file that was not committed is removed. NULL is allowed.
void pm_hdf5_close(pm_hdf5 *file);

// --- names: attributes of an object, members of a group; sorted, in the arena ---

pm_status pm_hdf5_attributes(const pm_hdf5 *file, const char *object, pm_arena *arena, int *count,
                             const char ***name);
pm_status pm_hdf5_members(const pm_hdf5 *file, const char *group, pm_arena *arena, int *count,
                          const char ***name);

// --- attributes; text is at most 60 KiB on writing ---

// True if the object has a single text of this name.
bool pm_hdf5_is_text(const pm_hdf5 *file, const char *object, const char *name);
pm_status pm_hdf5_read_text(const pm_hdf5 *file, const char *object, const char *name,
                            pm_arena *arena, const char **text);
pm_status pm_hdf5_read_texts(const pm_hdf5 *file, const char *object, const char *name,
                             pm_arena *arena, int *count, const char ***text);
// Up to `capacity` integers; negative ones read as 0.
pm_status pm_hdf5_read_integers(const pm_hdf5 *file, const char *object, const char *name,
                                int capacity, uint64_t *value, int *count);
pm_status pm_hdf5_read_integer(const pm_hdf5 *file, const char *object, const char *name,
                               uint64_t *value);
pm_status pm_hdf5_read_number(const pm_hdf5 *file, const char *object, const char *name,
                              double *value);

pm_status pm_hdf5_write_text(pm_hdf5 *file, const char *object, const char *name, const char *text);
pm_status pm_hdf5_write_texts(pm_hdf5 *file, const char *object, const char *name, int count,
                              const char *const *text);
pm_status pm_hdf5_write_integers(pm_hdf5 *file, const char *object, const char *name, int count,
                                 const uint64_t *value);
pm_status pm_hdf5_write_integer(pm_hdf5 *file, const char *object, const char *name,
                                uint64_t value);
pm_status pm_hdf5_write_number(pm_hdf5 *file, const char *object, const char *name, double value);

// --- groups and datasets of floating-point numbers (4 or 8 bytes in the file, double here) ---

pm_status pm_hdf5_write_group(pm_hdf5 *file, const char *name);
// Whether there is something called `name`, such as "/z".
bool pm_hdf5_has(const pm_hdf5 *file, const char *name);
// The extents [rank] of a dataset; each at least 1. Rank 0: a scalar, `extent` may be NULL.
pm_status pm_hdf5_shape(const pm_hdf5 *file, const char *name, int rank, int *extent);
// Reads a dataset that must have exactly these extents. Values may be non-finite.
pm_status pm_hdf5_read(const pm_hdf5 *file, const char *name, int rank, const int *extent,
                       double *value);
// Where 4 bytes hold each of many numbers exactly, they take 4 bytes in the file.
pm_status pm_hdf5_write(pm_hdf5 *file, const char *name, int rank, const int *extent,
                        const double *value);

// --- series: datasets [sample] (width 0) or [sample][width] that grow ---

typedef struct pm_hdf5_series {
    pm_hdf5 *file;
    int64_t id; // the library's handle, closed with the file
    int width;
    int64_t count; // samples so far
} pm_hdf5_series;

// `integer`: stored as 64-bit integers. Grows in chunks of `chunk` samples.
pm_status pm_hdf5_series_create(pm_hdf5_series *series, pm_hdf5 *file, const char *name, int width,
                                int chunk, bool integer);
// A series that is there, cut down to its first `count` samples. PM_EFILE: it has fewer.
pm_status pm_hdf5_series_open(pm_hdf5_series *series, pm_hdf5 *file, const char *name, int width,
                              int64_t count);
// Appends value [count][width].
pm_status pm_hdf5_series_append(pm_hdf5_series *series, int count, const double *value);

#endif
