// HDF5 files: protection from damaged ones, opening, creating, committing, names, attributes,
// datasets and growing series. Every function closes the identifiers that it opens; closing a file
// closes all that remain (H5F_CLOSE_STRONG).
#include "store/hdf5_io.h"

#include <errno.h>
#include <fcntl.h>
#include <hdf5.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/child.h"
#include "base/files.h"
#include "store/hdf5_check.h"

#define INDEX_CACHE (1 << 18) // bytes of a file's index that are kept in memory at first
#define CAUSE_SIZE 1024       // of HDF5's description, which contains paths
#define CPU_LIMIT 20          // s; an attempt to open a file that takes longer hangs
#define STRIDE (1 << 20) // bytes that are reserved beyond what is asked for, where there is room
#define MAX_NAMES 65536  // attributes of an object, members of a group, or texts of an attribute
#define NAME_SIZE 256    // bytes of the longest name, with its terminating zero
#define MAX_TEXT ((size_t)1 << 20)    // bytes of all texts of an attribute, far beyond any real one
#define MAX_VALUES ((hsize_t)1 << 28) // of a dataset: 2 GiB as double
#define WORTH_FLOATS 1024 // from this number of values on, half the space is worth the check

struct pm_hdf5 {
    hid_t file;        // negative once closed
    hid_t access;      // the property list of every access: it refuses links into other files
    bool broken;       // a write has failed: the library is not called for this file any more
    int64_t reserved;  // bytes from the start of the file that the disk holds free for it
    pm_status content; // the code with which readers report wrong content
    char *path;
    char *temporary; // the file that is written until commit; NULL when reading or IN_PLACE
};

// Closes any kind of identifier; a negative one is ignored.
static void release(hid_t id) {
    if (id >= 0) {
        H5Idec_ref(id);
    }
}

// --- failures ---

static herr_t take_first(unsigned n, const H5E_error2_t *error, void *cause) {
    if (n == 0 && error->desc != NULL) {
        snprintf(cause, CAUSE_SIZE, "%s", error->desc);
    }
    return 0;
}

// Fails with the innermost cause that HDF5 gives: "PATH: cannot WHAT OBJECT (cause)". If the
// operating system has refused, HDF5's description has several lines, of which only the system's
// own message is kept.
static pm_status fail_with_cause(pm_status code, const char *path, const char *what,
                                 const char *object) {
    static const char opening[] = "error message = '";
    char text[CAUSE_SIZE] = "cause unknown", *cause = text;
    H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take_first, text);
    char *word = strstr(text, opening);
    if (word != NULL) {
        cause = word + strlen(opening);
        cause[strcspn(cause, "'")] = '\0';
    }
    cause[strcspn(cause, "\n")] = '\0';
    return pm_fail(code, "%s: cannot %s %s (%s)", path, what, object, cause);
}

// Fails with PM_EFILE: "PATH: cannot write OBJECT (cause)", and marks the file as broken. Objects
// that are open in the file stay open.
static pm_status fail_write(pm_hdf5 *file, const char *object) {
    file->broken = true;
    return fail_with_cause(PM_EFILE, file->path, "write", object);
}

// --- protection from damaged files ---

// Returns the reason not to give the file to the library; NULL: there is none.
static const char *objection_to(const char *path) {
    const int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    struct stat facts;
    const char *objection = "it cannot be read";
    if (file >= 0 && fstat(file, &facts) == 0 && S_ISREG(facts.st_mode) && facts.st_size > 0) {
        const size_t size = (size_t)facts.st_size;
        void *data = mmap(NULL, size, PROT_READ, MAP_PRIVATE, file, 0);
        if (data != MAP_FAILED) {
            objection = pm_hdf5_check(data, size);
            munmap(data, size);
        }
    }
    if (file >= 0) {
        close(file);
    }
    return objection;
}

bool pm_hdf5_is_own(const char *path) {
    return objection_to(path) == NULL;
}

static void limit(int resource, rlim_t most) {
    struct rlimit now;
    if (getrlimit((__rlimit_resource_t)resource, &now) == 0 && now.rlim_cur > most) {
        now.rlim_cur = most;
        setrlimit((__rlimit_resource_t)resource, &now);
    }
}

pm_status pm_hdf5_try(const char *path, void (*work)(const void *context), const void *context) {
    if (pm_hdf5_is_own(path)) {
        return PM_OK;
    }
    const pid_t child = fork();
    if (child == 0) {
        const long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
        limit(RLIMIT_CPU, CPU_LIMIT);
        limit(RLIMIT_CORE, 0);
        // A process that asks for more than the machine's memory would take others down with it.
        if (PM_HDF5_TRY_LIMITS_MEMORY && pages > 0 && size > 0) {
            limit(RLIMIT_AS, (rlim_t)pages * (rlim_t)size);
        }
        work(context);
        H5close();
        _exit(0);
    }
    int end = 0;
    const int error = pm_child_wait(child, &end);
    if (error != 0) {
        return pm_fail(PM_ENOMEM, "%s: cannot start a child process to open it: %s", path,
                       strerror(error));
    }
    if (WIFEXITED(end) && WEXITSTATUS(end) == 0) {
        return PM_OK;
    }
    return pm_fail(PM_EFILE, "%s: the file is damaged: the HDF5 library crashes on it%s%s%s", path,
                   WIFSIGNALED(end) ? " (" : "", WIFSIGNALED(end) ? strsignal(WTERMSIG(end)) : "",
                   WIFSIGNALED(end) ? ")" : "");
}

// --- files ---

static herr_t refuse_link(const char *parent_file, const char *parent_group, const char *file,
                          const char *object, unsigned *flags, hid_t access, void *data) {
    (void)parent_file, (void)parent_group, (void)file, (void)object, (void)flags, (void)access;
    (void)data;
    return -1;
}

// Makes a handle without a file, and stops the library from printing its errors. Keeps the library
// from closing files when the process exits: it would crash on a file that could not be written.
// This must be the first call of the library, and even its macros for access flags call it. The
// caller closes the handle, on failure too.
static pm_status handle_new(pm_hdf5 **handle, const char *path, pm_status content) {
    H5dont_atexit();
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    pm_hdf5 *file = calloc(1, sizeof *file);
    PM_TRY(pm_allocated(file, "%s", path));
    *handle = file;
    file->file = H5I_INVALID_HID;
    file->content = content;
    file->path = strdup(path);
    file->access = H5Pcreate(H5P_LINK_ACCESS);
    return file->path == NULL || file->access < 0 ||
                   H5Pset_elink_cb(file->access, refuse_link, NULL) < 0
               ? pm_fail(PM_ENOMEM, "%s: out of memory", path)
               : PM_OK;
}

// Chooses the earliest file format, which stays readable when its writer is killed, strong closing,
// and a small cache of a file's index at first. The cache grows where the index does not fit; an
// entry takes ten times the memory that the library counts for it.
static hid_t file_access(void) {
    H5AC_cache_config_t config = {.version = H5AC__CURR_CACHE_CONFIG_VERSION};
    const hid_t list = H5Pcreate(H5P_FILE_ACCESS);
    if (list >= 0) {
        if (H5Pget_mdc_config(list, &config) >= 0) {
            config.set_initial_size = true;
            config.initial_size = config.min_size = INDEX_CACHE;
            H5Pset_mdc_config(list, &config);
        }
        H5Pset_fclose_degree(list, H5F_CLOSE_STRONG);
        H5Pset_libver_bounds(list, H5F_LIBVER_EARLIEST, H5F_LIBVER_LATEST);
    }
    return list;
}

static pm_status open_as(pm_hdf5 **file, const char *path, pm_hdf5_source source, pm_status content,
                         bool to_write) {
    struct stat facts;
    if (stat(path, &facts) != 0) {
        return pm_fail(PM_EFILE, "%s: cannot be opened: %s", path, strerror(errno));
    }
    if (!S_ISREG(facts.st_mode)) {
        return pm_fail(PM_EFILE, "%s: %s, expected an HDF5 file", path,
                       S_ISDIR(facts.st_mode) ? "a directory" : "not a regular file");
    }
    if (access(path, R_OK) != 0) {
        return pm_fail(PM_EFILE, "%s: cannot be read: %s", path, strerror(errno));
    }
    pm_hdf5 *opened = NULL;
    pm_status status;
    PM_TRY_DONE(handle_new(&opened, path, content));
    if (H5Fis_hdf5(path) <= 0) {
        PM_TRY_DONE(pm_fail(PM_EFILE, "%s: not an HDF5 file", path));
    }
    const char *objection = source == PM_HDF5_OWN ? objection_to(path) : NULL;
    if (objection != NULL) {
        PM_TRY_DONE(
            pm_fail(PM_EFILE, "%s: damaged, or not written by portmet: %s", path, objection));
    }
    const hid_t list = file_access();
    opened->file = H5Fopen(path, to_write ? H5F_ACC_RDWR : H5F_ACC_RDONLY, list);
    status = opened->file < 0 ? fail_with_cause(PM_EFILE, path, "open", "it as HDF5") : PM_OK;
    release(list);
    PM_TRY_DONE(status);
    if (!to_write) {
        pm_files_note_input(path);
    }
    *file = opened;
    opened = NULL;
done:
    pm_hdf5_close(opened);
    return status;
}

pm_status pm_hdf5_open(pm_hdf5 **file, const char *path, pm_hdf5_source source, pm_status content) {
    return open_as(file, path, source, content, false);
}

pm_status pm_hdf5_reopen(pm_hdf5 **file, const char *path) {
    return open_as(file, path, PM_HDF5_ANY, PM_EFILE, true);
}

pm_status pm_hdf5_create(pm_hdf5 **file, const char *path, pm_hdf5_mode mode) {
    pm_hdf5 *created = NULL;
    pm_status status;
    PM_TRY_DONE(pm_files_check_output(path, mode == PM_HDF5_ATOMIC    ? PM_FILES_HDF5
                                            : mode == PM_HDF5_WEIGHTS ? PM_FILES_WEIGHTS
                                                                      : PM_FILES_ANY));
    PM_TRY_DONE(handle_new(&created, path, PM_EFILE));
    if (mode != PM_HDF5_IN_PLACE) {
        if (asprintf(&created->temporary, "%s.%ld.tmp", path, (long)getpid()) < 0) {
            created->temporary = NULL;
            PM_TRY_DONE(pm_fail(PM_ENOMEM, "%s: out of memory", path));
        }
        unlink(created->temporary);
    }
    // Exclusive creation never writes to a file or link of somebody else.
    const bool exclusive = created->temporary != NULL;
    const hid_t list = file_access();
    created->file = H5Fcreate(exclusive ? created->temporary : path,
                              exclusive ? H5F_ACC_EXCL : H5F_ACC_TRUNC, H5P_DEFAULT, list);
    status = created->file < 0 ? fail_with_cause(PM_EFILE, path, "create", "the file") : PM_OK;
    release(list);
    PM_TRY_DONE(status);
    if (!exclusive) {
        pm_files_note_output(path);
    }
    *file = created;
    created = NULL;
done:
    pm_hdf5_close(created);
    return status;
}

pm_status pm_hdf5_flush(pm_hdf5 *file) {
    hsize_t end = 0;
    if (H5Fflush(file->file, H5F_SCOPE_LOCAL) < 0 || H5Fget_filesize(file->file, &end) < 0) {
        return fail_write(file, "/");
    }
    // The library has cut off what was reserved beyond the end.
    file->reserved = (int64_t)end < file->reserved ? (int64_t)end : file->reserved;
    return PM_OK;
}

bool pm_hdf5_is_broken(const pm_hdf5 *file) {
    return file->broken;
}

// Gives back the space that was reserved beyond the end of a file that is closed.
static void trim(const pm_hdf5 *file) {
    struct stat facts;
    if (file->reserved > 0 && stat(file->path, &facts) == 0) {
        (void)!truncate(file->path, facts.st_size);
    }
}

pm_status pm_hdf5_commit(pm_hdf5 *file) {
    const herr_t closed = H5Fclose(file->file);
    file->file = H5I_INVALID_HID;
    if (closed < 0) {
        return fail_write(file, "/");
    }
    trim(file);
    if (file->temporary != NULL) {
        const int descriptor = open(file->temporary, O_RDONLY | O_CLOEXEC);
        const bool synced = descriptor >= 0 && fsync(descriptor) == 0;
        const int cause = errno;
        if (descriptor >= 0) {
            close(descriptor);
        }
        if (!synced) {
            return pm_fail(PM_EFILE, "%s: cannot be written: %s", file->path, strerror(cause));
        }
        if (rename(file->temporary, file->path) != 0) {
            return pm_fail(PM_EFILE, "%s: cannot be written: %s", file->path, strerror(errno));
        }
        pm_files_note_output(file->path);
        free(file->temporary);
        file->temporary = NULL;
    }
    return PM_OK;
}

void pm_hdf5_close(pm_hdf5 *file) {
    if (file == NULL) {
        return;
    }
    // After a failed write the library's picture of the file is not that of the disk, and closing
    // the file would crash.
    if (file->file >= 0 && !file->broken) {
        H5Fclose(file->file);
        trim(file);
    }
    release(file->access);
    if (file->temporary != NULL) {
        unlink(file->temporary);
        free(file->temporary);
    }
    free(file->path);
    free(file);
}

// --- space on the disk ---
//
// The library does not survive a write that fails halfway, so space is reserved ahead of it. The
// reserved space begins at the start of the file and has no gaps.

// Reserves the bytes up to `end`. Returns 0, or the cause as errno has it.
static int reserve_up_to(pm_hdf5 *file, int descriptor, int64_t end) {
    struct rlimit most; // of a file of this process
    if (getrlimit(RLIMIT_FSIZE, &most) == 0 && most.rlim_cur != RLIM_INFINITY &&
        (rlim_t)end > most.rlim_cur) {
        return EFBIG;
    }
    int failed;
    do {
        failed = fallocate(descriptor, FALLOC_FL_KEEP_SIZE, file->reserved, end - file->reserved);
    } while (failed != 0 && errno == EINTR);
    if (failed == 0) {
        file->reserved = end;
    }
    return failed == 0 ? 0 : errno;
}

static bool means_full(int cause) {
    return cause == ENOSPC || cause == EDQUOT || cause == EFBIG;
}

pm_status pm_hdf5_reserve(pm_hdf5 *file, int64_t size) {
    hsize_t end = 0;
    void *handle = NULL;
    if (H5Fget_filesize(file->file, &end) < 0 ||
        H5Fget_vfd_handle(file->file, H5P_DEFAULT, &handle) < 0) {
        return fail_write(file, "samples");
    }
    const int64_t needed = (int64_t)end + size;
    if (needed <= file->reserved) {
        return PM_OK;
    }
    const int descriptor = *(const int *)handle;
    int cause = reserve_up_to(file, descriptor, needed + STRIDE);
    if (means_full(cause)) {
        cause = reserve_up_to(file, descriptor, needed);
    }
    return means_full(cause)
               ? pm_fail(PM_EFILE, "%s: cannot write samples (%s)", file->path, strerror(cause))
               : PM_OK;
}

// --- names ---

static ssize_t name_at(const pm_hdf5 *file, const char *object, bool attribute, hsize_t i,
                       char *name) {
    return attribute ? H5Aget_name_by_idx(file->file, object, H5_INDEX_NAME, H5_ITER_INC, i, name,
                                          NAME_SIZE, file->access)
                     : H5Lget_name_by_idx(file->file, object, H5_INDEX_NAME, H5_ITER_INC, i, name,
                                          NAME_SIZE, file->access);
}

static pm_status list_names(const pm_hdf5 *file, const char *object, bool attribute,
                            pm_arena *arena, int *count, const char ***name) {
    char text[NAME_SIZE];
    int n = 0;
    while (n < MAX_NAMES && name_at(file, object, attribute, (hsize_t)n, text) >= 0) {
        ++n;
    }
    if (n == MAX_NAMES) {
        return pm_fail(file->content, "%s: %s has more than %d entries", file->path, object, n - 1);
    }
    const char **list = pm_arena_array(arena, (size_t)n, sizeof *list);
    for (int i = 0; list != NULL && i < n; ++i) {
        name_at(file, object, attribute, (hsize_t)i, text);
        list[i] = pm_arena_strdup(arena, text);
    }
    PM_TRY(pm_arena_status(arena, "the names in %s", file->path));
    *count = n;
    *name = list;
    return PM_OK;
}

pm_status pm_hdf5_attributes(const pm_hdf5 *file, const char *object, pm_arena *arena, int *count,
                             const char ***name) {
    return list_names(file, object, true, arena, count, name);
}

pm_status pm_hdf5_members(const pm_hdf5 *file, const char *group, pm_arena *arena, int *count,
                          const char ***name) {
    return list_names(file, group, false, arena, count, name);
}

// --- reading attributes ---

typedef struct attribute {
    hid_t id, type, space;
    hssize_t count;
} attribute;

static void attribute_close(attribute *a) {
    release(a->space);
    release(a->type);
    release(a->id);
}

// Opens an attribute of the given type class with `least` to `capacity` values. The caller closes
// it after PM_OK.
static pm_status attribute_open(const pm_hdf5 *file, const char *object, const char *name,
                                H5T_class_t class, int least, int capacity, attribute *a) {
    *a = (attribute){.type = H5I_INVALID_HID, .space = H5I_INVALID_HID};
    a->id = H5Aopen_by_name(file->file, object, name, H5P_DEFAULT, file->access);
    if (a->id < 0) {
        return pm_fail(file->content, "%s: attribute %s of %s is missing", file->path, name,
                       object);
    }
    a->type = H5Aget_type(a->id);
    a->space = H5Aget_space(a->id);
    a->count = H5Sget_simple_extent_npoints(a->space);
    if (a->type < 0 || H5Tget_class(a->type) != class || a->count < 0 || a->count > capacity) {
        const char *what = class == H5T_STRING    ? "text"
                           : class == H5T_INTEGER ? "integer"
                                                  : "floating-point";
        attribute_close(a);
        return pm_fail(file->content, "%s: attribute %s of %s: expected %s, at most %d value%s",
                       file->path, name, object, what, capacity, capacity == 1 ? "" : "s");
    }
    if (a->count < least) {
        attribute_close(a);
        return pm_fail(file->content, "%s: attribute %s of %s is empty", file->path, name, object);
    }
    return PM_OK;
}

bool pm_hdf5_is_text(const pm_hdf5 *file, const char *object, const char *name) {
    attribute a;
    if (attribute_open(file, object, name, H5T_STRING, 1, 1, &a) != PM_OK) {
        return false;
    }
    attribute_close(&a);
    return true;
}

// Text ends up in messages and paths, so the only control characters may be tabs and line ends.
static bool text_is_printable(const char *text) {
    for (; *text != '\0'; ++text) {
        const unsigned char byte = (unsigned char)*text;
        if ((byte < ' ' && byte != '\n' && byte != '\t') || byte == 0x7f) {
            return false;
        }
    }
    return true;
}

// Makes a type for text of `size` bytes with its terminator, or of H5T_VARIABLE length.
static hid_t memory_text_type(H5T_cset_t letters, size_t size) {
    const hid_t memory = H5Tcopy(H5T_C_S1);
    if (memory >= 0) {
        H5Tset_size(memory, size);
        H5Tset_cset(memory, letters);
    }
    return memory;
}

pm_status pm_hdf5_read_texts(const pm_hdf5 *file, const char *object, const char *name,
                             pm_arena *arena, int *count, const char ***text) {
    attribute a;
    PM_TRY(attribute_open(file, object, name, H5T_STRING, 0, MAX_NAMES, &a));
    const char **list = pm_arena_array(arena, (size_t)a.count, sizeof *list);
    const bool variable = H5Tis_variable_str(a.type) > 0;
    const size_t ntext = (size_t)a.count;
    const size_t size = variable ? sizeof(char *) : H5Tget_size(a.type) + 1;
    const bool is_short = size <= MAX_TEXT && (ntext == 0 || size <= MAX_TEXT / ntext);
    char *buffer = is_short ? calloc(ntext + 1, size) : NULL;
    const hid_t memory = memory_text_type(H5Tget_cset(a.type), variable ? H5T_VARIABLE : size);
    const bool readable = buffer != NULL && memory >= 0 && H5Aread(a.id, memory, buffer) >= 0;
    bool good = readable && list != NULL;
    for (size_t i = 0; good && i < ntext; ++i) {
        const char *one = buffer + i * size;
        if (variable) {
            memcpy(&one, buffer + i * size, sizeof one);
        }
        one = one == NULL ? "" : one;
        good = strnlen(one, MAX_TEXT) < MAX_TEXT && text_is_printable(one);
        list[i] = good ? pm_arena_strdup(arena, one) : NULL;
        good = list[i] != NULL;
    }
    if (readable && variable) {
        H5Dvlen_reclaim(memory, a.space, H5P_DEFAULT, buffer);
    }
    release(memory);
    free(buffer);
    attribute_close(&a);
    if (!good) {
        return pm_fail(file->content, "%s: attribute %s of %s: text is unreadable or too long",
                       file->path, name, object);
    }
    *count = (int)a.count;
    *text = list;
    return PM_OK;
}

pm_status pm_hdf5_read_text(const pm_hdf5 *file, const char *object, const char *name,
                            pm_arena *arena, const char **text) {
    attribute a;
    PM_TRY(attribute_open(file, object, name, H5T_STRING, 1, 1, &a));
    attribute_close(&a);
    int count;
    const char **list;
    PM_TRY(pm_hdf5_read_texts(file, object, name, arena, &count, &list));
    *text = list[0];
    return PM_OK;
}

// Reads the numbers of an open attribute and closes it.
static pm_status read_values(const pm_hdf5 *file, attribute *a, const char *name, hid_t memory,
                             void *value) {
    const pm_status status =
        H5Aread(a->id, memory, value) < 0
            ? fail_with_cause(file->content, file->path, "read attribute", name)
            : PM_OK;
    attribute_close(a);
    return status;
}

pm_status pm_hdf5_read_integers(const pm_hdf5 *file, const char *object, const char *name,
                                int capacity, uint64_t *value, int *count) {
    attribute a;
    PM_TRY(attribute_open(file, object, name, H5T_INTEGER, 0, capacity, &a));
    *count = (int)a.count;
    return read_values(file, &a, name, H5T_NATIVE_UINT64, value);
}

pm_status pm_hdf5_read_integer(const pm_hdf5 *file, const char *object, const char *name,
                               uint64_t *value) {
    attribute a;
    PM_TRY(attribute_open(file, object, name, H5T_INTEGER, 1, 1, &a));
    return read_values(file, &a, name, H5T_NATIVE_UINT64, value);
}

pm_status pm_hdf5_read_number(const pm_hdf5 *file, const char *object, const char *name,
                              double *value) {
    attribute a;
    PM_TRY(attribute_open(file, object, name, H5T_FLOAT, 1, 1, &a));
    return read_values(file, &a, name, H5T_NATIVE_DOUBLE, value);
}

// --- writing attributes ---

// Writes value [count] as an attribute; count < 0 means a scalar.
static pm_status write_attribute(pm_hdf5 *file, const char *object, const char *name, int count,
                                 hid_t stored, hid_t memory, const void *value) {
    const hsize_t extent = count < 0 ? 1 : (hsize_t)count;
    const hid_t space = count < 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &extent, NULL);
    const hid_t id = H5Acreate_by_name(file->file, object, name, stored, space, H5P_DEFAULT,
                                       H5P_DEFAULT, file->access);
    const bool written = id >= 0 && (extent == 0 || H5Awrite(id, memory, value) >= 0);
    const pm_status status = written ? PM_OK : fail_write(file, name);
    release(id);
    release(space);
    return status;
}

// Writes text of fixed length. The library keeps text of variable length in a heap that it does not
// check, and crashes on a damaged one.
static pm_status write_text_attribute(pm_hdf5 *file, const char *object, const char *name,
                                      int count, const char *const *text) {
    const size_t ntext = count < 0 ? 1 : (size_t)count;
    size_t size = 1;
    for (size_t i = 0; i < ntext; ++i) {
        const size_t length = strlen(text[i]) + 1;
        size = length > size ? length : size;
    }
    char *buffer = calloc(ntext + 1, size);
    PM_TRY(pm_allocated(buffer, "%s", file->path));
    for (size_t i = 0; i < ntext; ++i) {
        strcpy(buffer + i * size, text[i]);
    }
    const hid_t type = memory_text_type(H5T_CSET_UTF8, size);
    const pm_status status = write_attribute(file, object, name, count, type, type, buffer);
    release(type);
    free(buffer);
    return status;
}

pm_status pm_hdf5_write_text(pm_hdf5 *file, const char *object, const char *name,
                             const char *text) {
    return write_text_attribute(file, object, name, -1, &text);
}

pm_status pm_hdf5_write_texts(pm_hdf5 *file, const char *object, const char *name, int count,
                              const char *const *text) {
    return write_text_attribute(file, object, name, count, text);
}

pm_status pm_hdf5_write_integers(pm_hdf5 *file, const char *object, const char *name, int count,
                                 const uint64_t *value) {
    return write_attribute(file, object, name, count, H5T_STD_U64LE, H5T_NATIVE_UINT64, value);
}

pm_status pm_hdf5_write_integer(pm_hdf5 *file, const char *object, const char *name,
                                uint64_t value) {
    return write_attribute(file, object, name, -1, H5T_STD_U64LE, H5T_NATIVE_UINT64, &value);
}

pm_status pm_hdf5_write_number(pm_hdf5 *file, const char *object, const char *name, double value) {
    return write_attribute(file, object, name, -1, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value);
}

pm_status pm_hdf5_update_integer(pm_hdf5 *file, const char *object, const char *name,
                                 uint64_t value) {
    const hid_t id = H5Aopen_by_name(file->file, object, name, H5P_DEFAULT, file->access);
    const bool written = id >= 0 && H5Awrite(id, H5T_NATIVE_UINT64, &value) >= 0;
    const pm_status status = written ? PM_OK : fail_write(file, name);
    release(id);
    return status;
}

// --- groups and datasets ---

// Link creation that makes missing parent groups.
static hid_t with_parents(void) {
    const hid_t list = H5Pcreate(H5P_LINK_CREATE);
    if (list >= 0) {
        H5Pset_create_intermediate_group(list, 1);
    }
    return list;
}

pm_status pm_hdf5_write_group(pm_hdf5 *file, const char *name) {
    const hid_t list = with_parents();
    const hid_t id = H5Gcreate2(file->file, name, list, H5P_DEFAULT, H5P_DEFAULT);
    const pm_status status = id < 0 ? fail_write(file, name) : PM_OK;
    release(id);
    release(list);
    return status;
}

// Returns true if the numbers lie in this very file, as floats of 4 or 8 bytes or, in data, which
// any tool may have written, as integers.
static bool storage_is_plain(const pm_hdf5 *file, hid_t id) {
    const hid_t type = H5Dget_type(id);
    const hid_t list = H5Dget_create_plist(id);
    const size_t size = type < 0 ? 0 : H5Tget_size(type);
    const H5T_class_t class = type < 0 ? H5T_NO_CLASS : H5Tget_class(type);
    const bool number = (class == H5T_FLOAT && (size == 4 || size == 8)) ||
                        (class == H5T_INTEGER && file->content == PM_EDATA);
    const bool plain = list >= 0 && number && H5Pget_external_count(list) == 0 &&
                       H5Pget_layout(list) != H5D_VIRTUAL;
    release(list);
    release(type);
    return plain;
}

// Gives extent [rank] of an open dataset; false if its rank differs or an extent is out of bounds.
static bool bounded_extents(hid_t id, int rank, int *extent) {
    hsize_t size[PM_HDF5_MAX_RANK] = {0}, total = 1;
    const hid_t space = H5Dget_space(id);
    bool good = space >= 0 && H5Sget_simple_extent_type(space) != H5S_NULL &&
                H5Sget_simple_extent_ndims(space) == rank &&
                H5Sget_simple_extent_dims(space, size, NULL) >= 0;
    for (int i = 0; good && i < rank; ++i) {
        good = size[i] >= 1 && size[i] <= MAX_VALUES / total;
        total *= good ? size[i] : 1;
        extent[i] = good ? (int)size[i] : 0;
    }
    release(space);
    return good;
}

static pm_status dataset_open(const pm_hdf5 *file, const char *name, int rank, int *extent,
                              hid_t *dataset) {
    const hid_t id = H5Oopen(file->file, name, file->access);
    if (id < 0 || H5Iget_type(id) != H5I_DATASET) {
        release(id);
        return pm_fail(file->content, "%s: dataset %s is missing", file->path, name);
    }
    if (!storage_is_plain(file, id)) {
        release(id);
        return pm_fail(file->content, "%s: dataset %s: expected float64 or float32 numbers",
                       file->path, name);
    }
    if (!bounded_extents(id, rank, extent)) {
        release(id);
        return pm_fail(file->content,
                       "%s: dataset %s: expected %d dimensions, none of them empty, and at most "
                       "%llu values",
                       file->path, name, rank, (unsigned long long)MAX_VALUES);
    }
    *dataset = id;
    return PM_OK;
}

// Returns the number in the first line of a file that begins with `word`, which may be empty, or
// -1.
static int64_t read_number(const char *path, const char *word) {
    FILE *file = fopen(path, "re");
    char line[256];
    int64_t number = -1;
    while (file != NULL && number < 0 && fgets(line, sizeof line, file) != NULL) {
        if (strncmp(line, word, strlen(word)) != 0 ||
            sscanf(line + strlen(word), "%" SCNd64, &number) != 1) {
            number = -1;
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return number;
}

// Returns the number of bytes that this process can still allocate, as far as the system tells: the
// least of the memory that the kernel holds available, what is left of the limit of the control
// group (version 2), and the limit of the process's address space. INT64_MAX: nothing is known.
static int64_t memory_available(void) {
    int64_t available = INT64_MAX;
    const int64_t free = read_number("/proc/meminfo", "MemAvailable:"); // KiB
    if (free >= 0) {
        available = free * 1024;
    }
    // "max", which is no number, means that there is no limit.
    const int64_t most = read_number("/sys/fs/cgroup/memory.max", "");
    const int64_t used = read_number("/sys/fs/cgroup/memory.current", "");
    if (most >= 0 && used >= 0) {
        const int64_t left = most > used ? most - used : 0;
        available = left < available ? left : available;
    }
    struct rlimit most_addresses;
    if (getrlimit(RLIMIT_AS, &most_addresses) == 0 &&
        most_addresses.rlim_cur <= (rlim_t)available) {
        available = (int64_t)most_addresses.rlim_cur;
    }
    return available;
}

bool pm_hdf5_has(const pm_hdf5 *file, const char *name) {
    return H5Lexists(file->file, name, H5P_DEFAULT) > 0;
}

pm_status pm_hdf5_shape(const pm_hdf5 *file, const char *name, int rank, int *extent) {
    hid_t id = H5I_INVALID_HID;
    PM_TRY(dataset_open(file, name, rank, extent, &id));
    release(id);
    int64_t size = (int64_t)sizeof(double);
    for (int i = 0; i < rank; ++i) {
        size *= extent[i];
    }
    const int64_t available = memory_available();
    return size <= available
               ? PM_OK
               : pm_fail(PM_ENOMEM,
                         "%s: dataset %s takes %.3g MB of memory, and %.3g MB are available",
                         file->path, name, 1e-6 * (double)size, 1e-6 * (double)available);
}

pm_status pm_hdf5_read(const pm_hdf5 *file, const char *name, int rank, const int *extent,
                       double *value) {
    int found[PM_HDF5_MAX_RANK];
    hid_t id = H5I_INVALID_HID;
    PM_TRY(dataset_open(file, name, rank, found, &id));
    pm_status status = PM_OK;
    for (int i = 0; i < rank && status == PM_OK; ++i) {
        if (found[i] != extent[i]) {
            status = pm_fail(file->content, "%s: dataset %s: dimension %d is %d, expected %d",
                             file->path, name, i + 1, found[i], extent[i]);
        }
    }
    if (status == PM_OK &&
        H5Dread(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) < 0) {
        status = fail_with_cause(file->content, file->path, "read", name);
    }
    release(id);
    return status;
}

pm_status pm_hdf5_read_row(const pm_hdf5 *file, const char *name, int row, int extent,
                           double *value) {
    const hsize_t start[2] = {(hsize_t)row, 0}, block[2] = {1, (hsize_t)extent};
    hsize_t size[2] = {0, 0};
    const hid_t id = H5Dopen2(file->file, name, H5P_DEFAULT);
    const hid_t space = id < 0 ? H5I_INVALID_HID : H5Dget_space(id);
    const hid_t memory = H5Screate_simple(2, block, NULL);
    const bool good = space >= 0 && storage_is_plain(file, id) &&
                      H5Sget_simple_extent_ndims(space) == 2 &&
                      H5Sget_simple_extent_dims(space, size, NULL) == 2 && start[0] < size[0] &&
                      block[1] == size[1] &&
                      H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, block, NULL) >= 0 &&
                      H5Dread(id, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, value) >= 0;
    release(memory);
    release(space);
    release(id);
    return good ? PM_OK
                : pm_fail(file->content, "%s: %s: expected a row %d of %d numbers", file->path,
                          name, row, extent);
}

// Dataset creation without the time of writing, so that equal content makes equal files.
static hid_t without_times(void) {
    const hid_t list = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_obj_track_times(list, false);
    return list;
}

pm_status pm_hdf5_write(pm_hdf5 *file, const char *name, int rank, const int *extent,
                        const double *value) {
    hsize_t size[PM_HDF5_MAX_RANK];
    size_t count = 1;
    for (int i = 0; i < rank; ++i) {
        size[i] = (hsize_t)extent[i];
        count *= (size_t)extent[i];
    }
    const hid_t parents = with_parents(), list = without_times();
    const hid_t space = rank == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(rank, size, NULL);
    size_t nfloat = 0; // numbers at the beginning that 4 bytes hold exactly
    while (nfloat < count && (double)(float)value[nfloat] == value[nfloat]) {
        ++nfloat;
    }
    const hid_t type = nfloat == count && count >= WORTH_FLOATS ? H5T_IEEE_F32LE : H5T_IEEE_F64LE;
    const hid_t id = H5Dcreate2(file->file, name, type, space, parents, list, H5P_DEFAULT);
    // The library keeps small datasets in memory, and writes them when they are closed.
    const bool written =
        id >= 0 && H5Dwrite(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) >= 0 &&
        H5Dclose(id) >= 0;
    const pm_status status = written ? PM_OK : fail_write(file, name);
    release(space);
    release(list);
    release(parents);
    return status;
}

// --- series ---

// Dataset access that keeps only the last chunk in memory. By default the library keeps a mebibyte
// of each dataset, and a recording has a dataset for each quantity of each part.
static hid_t with_one_chunk(const pm_hdf5_series *series, int chunk) {
    size_t size = (size_t)chunk * sizeof(double);
    for (int i = 0; i < series->rank; ++i) {
        size *= (size_t)series->extent[i];
    }
    const hid_t list = H5Pcreate(H5P_DATASET_ACCESS);
    H5Pset_chunk_cache(list, 1, size, H5D_CHUNK_CACHE_W0_DEFAULT);
    return list;
}

static pm_hdf5_series make_series(pm_hdf5 *file, int rank, const int *extent) {
    pm_hdf5_series series = {.file = file, .rank = rank};
    for (int i = 0; i < rank; ++i) {
        series.extent[i] = extent[i];
    }
    return series;
}

// Writes the extents of `count` samples to size [1 + PM_HDF5_SERIES_RANK].
static void set_size(const pm_hdf5_series *series, hsize_t count, hsize_t *size) {
    size[0] = count;
    for (int i = 0; i < series->rank; ++i) {
        size[1 + i] = (hsize_t)series->extent[i];
    }
}

pm_status pm_hdf5_series_create(pm_hdf5_series *series, pm_hdf5 *file, const char *name, int rank,
                                const int *extent, int chunk, bool integer) {
    hsize_t size[1 + PM_HDF5_SERIES_RANK], limit[1 + PM_HDF5_SERIES_RANK],
        piece[1 + PM_HDF5_SERIES_RANK];
    *series = make_series(file, rank, extent);
    set_size(series, 0, size);
    set_size(series, H5S_UNLIMITED, limit);
    set_size(series, (hsize_t)chunk, piece);
    const hid_t parents = with_parents(), list = without_times();
    const hid_t access = with_one_chunk(series, chunk);
    const hid_t space = H5Screate_simple(1 + rank, size, limit);
    H5Pset_chunk(list, 1 + rank, piece);
    series->id = H5Dcreate2(file->file, name, integer ? H5T_STD_I64LE : H5T_IEEE_F64LE, space,
                            parents, list, access);
    const pm_status status = series->id < 0 ? fail_write(file, name) : PM_OK;
    release(list);
    release(access);
    release(space);
    release(parents);
    return status;
}

pm_status pm_hdf5_series_open(pm_hdf5_series *series, pm_hdf5 *file, const char *name, int rank,
                              const int *extent, int chunk, int64_t count) {
    hsize_t kept[1 + PM_HDF5_SERIES_RANK], size[1 + PM_HDF5_SERIES_RANK];
    *series = make_series(file, rank, extent);
    set_size(series, (hsize_t)count, kept);
    const hid_t access = with_one_chunk(series, chunk);
    series->id = H5Dopen2(file->file, name, access);
    series->count = count;
    const hid_t space = series->id < 0 ? H5I_INVALID_HID : H5Dget_space(series->id);
    const bool fits = space >= 0 && H5Sget_simple_extent_ndims(space) == 1 + rank &&
                      H5Sget_simple_extent_dims(space, size, NULL) == 1 + rank &&
                      size[0] >= kept[0] &&
                      memcmp(size + 1, kept + 1, (size_t)rank * sizeof *size) == 0;
    release(space);
    release(access);
    if (!fits || H5Dset_extent(series->id, kept) < 0) {
        release(series->id);
        return pm_fail(PM_EFILE, "%s: %s: expected a series of %lld samples to go on with",
                       file->path, name, (long long)count);
    }
    return PM_OK;
}

pm_status pm_hdf5_series_append(pm_hdf5_series *series, int count, const double *value) {
    const int rank = 1 + series->rank;
    const hsize_t start[1 + PM_HDF5_SERIES_RANK] = {(hsize_t)series->count};
    hsize_t block[1 + PM_HDF5_SERIES_RANK], size[1 + PM_HDF5_SERIES_RANK];
    set_size(series, (hsize_t)count, block);
    set_size(series, start[0] + (hsize_t)count, size);
    hid_t space = H5I_INVALID_HID;
    const hid_t memory = H5Screate_simple(rank, block, NULL);
    bool written = memory >= 0 && H5Dset_extent(series->id, size) >= 0;
    if (written) {
        space = H5Dget_space(series->id);
        written = space >= 0 &&
                  H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, block, NULL) >= 0 &&
                  H5Dwrite(series->id, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, value) >= 0;
    }
    const pm_status status = written ? PM_OK : fail_write(series->file, "samples");
    release(space);
    release(memory);
    series->count += written ? count : 0;
    return status;
}
