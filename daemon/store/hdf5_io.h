// Reads and writes HDF5 files and turns the library's errors into pm_status. Only the layer store/
// calls the library. Files are not trusted: a reader checks type, rank, extents, sizes and links
// before it reads, and does not follow links into other files. Objects are named by absolute paths
// such as "/" or "/parameters/energy.0.weight"; writing makes missing parents.
//
// All functions fail in the same way. PM_EFILE: a file cannot be opened or written. The code
// `content` of pm_hdf5_open: the content is not what the caller asked for. PM_ENOMEM.
#ifndef PM_STORE_HDF5_IO_H
#define PM_STORE_HDF5_IO_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_HDF5_MAX_RANK 4

typedef struct pm_hdf5 pm_hdf5;

// --- files ---

// The origin of a file. OWN: pm_hdf5_create wrote it; hdf5_check.h checks it before the library,
// which crashes on many damaged files, opens it. ANY: any tool wrote it, and the library reads what
// it can.
typedef enum pm_hdf5_source { PM_HDF5_OWN, PM_HDF5_ANY } pm_hdf5_source;

// Opens a file for reading. Readers return the code `content` if the file does not hold what they
// expect. The caller closes the file.
pm_status pm_hdf5_open(pm_hdf5 **file, const char *path, pm_hdf5_source source, pm_status content);
// Returns true if PM_HDF5_OWN would accept the file; false if it cannot be opened.
bool pm_hdf5_is_own(const char *path);

// Protects the caller from a file on which the HDF5 library crashes. If PM_HDF5_OWN would not
// accept the file, a child process calls work(context), which opens and reads it as the caller
// will; the results are lost. The child may use 20 s of CPU time and as much memory as the machine
// has. The caller must have no threads yet. PM_EFILE: the file ended the child; PM_ENOMEM: no
// process could be started.
pm_status pm_hdf5_try(const char *path, void (*work)(const void *context), const void *context);

// True if pm_hdf5_try limits the child's memory. Address sanitizers reserve more addresses than the
// machine has memory, so under them there is no limit.
#if defined(__SANITIZE_ADDRESS__)
#define PM_HDF5_TRY_LIMITS_MEMORY 0
#elif defined(__has_feature)
#define PM_HDF5_TRY_LIMITS_MEMORY !__has_feature(address_sanitizer)
#else
#define PM_HDF5_TRY_LIMITS_MEMORY 1
#endif

// Opens a file that was written IN_PLACE, so that the caller can continue to write it. The caller
// closes the file. PM_EFILE.
pm_status pm_hdf5_reopen(pm_hdf5 **file, const char *path);

// ATOMIC: the file has a temporary name in the same folder until pm_hdf5_commit moves it, whole, to
// `path`. IN_PLACE: the file is at `path` from the start, so that flushed content survives the
// death of its writer. WEIGHTS is ATOMIC for weights: they replace weights alone, and ATOMIC
// replaces neither weights nor recordings.
typedef enum pm_hdf5_mode { PM_HDF5_ATOMIC, PM_HDF5_WEIGHTS, PM_HDF5_IN_PLACE } pm_hdf5_mode;
// Creates an empty file for writing. It replaces a file of the same name, if there is one. The
// caller closes the file.
pm_status pm_hdf5_create(pm_hdf5 **file, const char *path, pm_hdf5_mode mode);
// Makes sure that the disk has room for the file to grow by `size` bytes, so that the next writes
// do not fail halfway. A flush gives back what was not used. A file whose space cannot be reserved
// stays sound and can be closed. Does nothing on a file system that cannot reserve space. PM_EFILE:
// the disk is full, or a limit of the user or of the process would be exceeded.
pm_status pm_hdf5_reserve(pm_hdf5 *file, int64_t size);
// Passes everything written so far to the operating system.
pm_status pm_hdf5_flush(pm_hdf5 *file);
// Returns true if any function that writes to the file has failed. The content of the file is then
// not certain, and only pm_hdf5_close may follow. A failed pm_hdf5_reserve does not count.
bool pm_hdf5_is_broken(const pm_hdf5 *file);
// Closes the file. An ATOMIC file is then synchronised with the disk and renamed. The caller must
// still call pm_hdf5_close, which frees the handle.
pm_status pm_hdf5_commit(pm_hdf5 *file);
// Frees the handle and removes an ATOMIC file that was not committed. NULL is allowed.
void pm_hdf5_close(pm_hdf5 *file);

// --- names ---

// List the attributes of an object, or the members of a group, sorted, in the arena: name [count].
pm_status pm_hdf5_attributes(const pm_hdf5 *file, const char *object, pm_arena *arena, int *count,
                             const char ***name);
pm_status pm_hdf5_members(const pm_hdf5 *file, const char *group, pm_arena *arena, int *count,
                          const char ***name);

// --- attributes ---

// Returns true if the object has an attribute of this name that is one text.
bool pm_hdf5_is_text(const pm_hdf5 *file, const char *object, const char *name);
// Read the attribute `name` of an object, which must be text: one text, or a list text [count], in
// the arena. It is an error of the content if the attribute is missing or of another type.
pm_status pm_hdf5_read_text(const pm_hdf5 *file, const char *object, const char *name,
                            pm_arena *arena, const char **text);
pm_status pm_hdf5_read_texts(const pm_hdf5 *file, const char *object, const char *name,
                             pm_arena *arena, int *count, const char ***text);
// Read numbers from the attribute `name` of an object. The first function reads a list of at most
// `capacity` integers into value [count]; the second one reads one integer, the third one
// floating-point number. Negative integers become 0. It is an error of the content if the attribute
// is missing, has another type, or has more values than `capacity`. The last two functions require
// exactly one value.
pm_status pm_hdf5_read_integers(const pm_hdf5 *file, const char *object, const char *name,
                                int capacity, uint64_t *value, int *count);
pm_status pm_hdf5_read_integer(const pm_hdf5 *file, const char *object, const char *name,
                               uint64_t *value);
pm_status pm_hdf5_read_number(const pm_hdf5 *file, const char *object, const char *name,
                              double *value);

// Write a new attribute `name` of an existing object: one text, the list text [count], the list
// value [count], one integer, or one floating-point number. An attribute takes at most
// 60 KiB.
pm_status pm_hdf5_write_text(pm_hdf5 *file, const char *object, const char *name, const char *text);
pm_status pm_hdf5_write_texts(pm_hdf5 *file, const char *object, const char *name, int count,
                              const char *const *text);
pm_status pm_hdf5_write_integers(pm_hdf5 *file, const char *object, const char *name, int count,
                                 const uint64_t *value);
pm_status pm_hdf5_write_integer(pm_hdf5 *file, const char *object, const char *name,
                                uint64_t value);
pm_status pm_hdf5_write_number(pm_hdf5 *file, const char *object, const char *name, double value);
// Replaces the value of an integer attribute that exists.
pm_status pm_hdf5_update_integer(pm_hdf5 *file, const char *object, const char *name,
                                 uint64_t value);

// --- groups and datasets of floating-point numbers (4 or 8 bytes in the file, double here) ---

// Makes an empty group.
pm_status pm_hdf5_write_group(pm_hdf5 *file, const char *name);
// Returns true if the file has an object of the name `name`, such as "/z".
bool pm_hdf5_has(const pm_hdf5 *file, const char *name);
// Gives extent [rank] of a dataset of this rank; each extent is at least 1. For a scalar, rank is 0
// and `extent` may be NULL. PM_ENOMEM: the values would take more memory than the process can have.
// A file of a few kilobytes may hold gigabytes of equal numbers.
pm_status pm_hdf5_shape(const pm_hdf5 *file, const char *name, int rank, int *extent);
// Reads a dataset that must have exactly these extents, row-major. Values need not be finite.
pm_status pm_hdf5_read(const pm_hdf5 *file, const char *name, int rank, const int *extent,
                       double *value);
// Reads value [extent], the numbers in row `row` of a dataset [rows][extent]. It is an error of the
// content if the dataset has no such row or rows of another extent.
pm_status pm_hdf5_read_row(const pm_hdf5 *file, const char *name, int row, int extent,
                           double *value);
// Writes a dataset. Numbers take 4 bytes each in the file if there are at least 1,024 of them and 4
// bytes hold every one exactly; otherwise 8.
pm_status pm_hdf5_write(pm_hdf5 *file, const char *name, int rank, const int *extent,
                        const double *value);

// --- series: datasets that grow, [sample], [sample][extent] or [sample][extent][extent] ---

#define PM_HDF5_SERIES_RANK 2

typedef struct pm_hdf5_series {
    pm_hdf5 *file;
    int64_t id;                      // the library's handle, which is closed with the file
    int rank;                        // of one sample: 0 to PM_HDF5_SERIES_RANK
    int extent[PM_HDF5_SERIES_RANK]; // [rank] of one sample
    int64_t count;                   // samples so far
} pm_hdf5_series;

// Makes an empty series whose samples have extent [rank]. The file grows by `chunk` samples at a
// time, and the library keeps at most one such chunk in memory. `integer`: the file holds 64-bit
// integers.
pm_status pm_hdf5_series_create(pm_hdf5_series *series, pm_hdf5 *file, const char *name, int rank,
                                const int *extent, int chunk, bool integer);
// Opens a series and truncates it to its first `count` samples. PM_EFILE: it has fewer, or samples
// of another shape.
pm_status pm_hdf5_series_open(pm_hdf5_series *series, pm_hdf5 *file, const char *name, int rank,
                              const int *extent, int chunk, int64_t count);
// Appends samples value [count][extent...].
pm_status pm_hdf5_series_append(pm_hdf5_series *series, int count, const double *value);

#endif
