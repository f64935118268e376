// HDF5 files: opening, creating, committing, and listing names. Every function closes the
// identifiers that it opens; closing a file closes all that remain (H5F_CLOSE_STRONG).
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "store/hdf5_check.h"
#include "store/hdf5_handle.h"

#define INDEX_CACHE (1 << 18) // bytes of a file's index that are kept in memory at first
#define CAUSE_SIZE 1024       // of HDF5's description, which contains paths

void pm_hdf5_release(hid_t id) {
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

// Shortens HDF5's description of a failure. If the operating system has refused, the description
// has several lines, of which only the system's own message is kept.
static const char *shorten_cause(char *cause) {
    static const char opening[] = "error message = '";
    char *word = strstr(cause, opening);
    if (word != NULL) {
        cause = word + strlen(opening);
        cause[strcspn(cause, "'")] = '\0';
    }
    cause[strcspn(cause, "\n")] = '\0';
    return cause;
}

pm_status pm_hdf5_fail(pm_status code, const char *path, const char *what, const char *object) {
    char cause[CAUSE_SIZE] = "cause unknown";
    H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take_first, cause);
    return pm_fail(code, "%s: cannot %s %s (%s)", path, what, object, shorten_cause(cause));
}

pm_status pm_hdf5_fail_write(pm_hdf5 *file, const char *object) {
    file->broken = true;
    return pm_hdf5_fail(PM_EFILE, file->path, "write", object);
}

pm_status pm_hdf5_fail_memory(const char *path) {
    return pm_fail(PM_ENOMEM, "%s: out of memory", path);
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
// This must be the first call of the library, and even its macros for access flags call it.
static pm_hdf5 *handle_new(const char *path, pm_status content) {
    H5dont_atexit();
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    pm_hdf5 *file = calloc(1, sizeof *file);
    if (file == NULL) {
        return NULL;
    }
    file->file = H5I_INVALID_HID;
    file->content = content;
    file->path = strdup(path);
    file->access = H5Pcreate(H5P_LINK_ACCESS);
    if (file->path == NULL || file->access < 0 ||
        H5Pset_elink_cb(file->access, refuse_link, NULL) < 0) {
        pm_hdf5_close(file);
        return NULL;
    }
    return file;
}

// Makes the library begin with a small cache of a file's index. The cache grows where the index
// does not fit; an entry takes ten times the memory that the library counts for it.
static void limit_index_cache(hid_t list) {
    H5AC_cache_config_t config = {.version = H5AC__CURR_CACHE_CONFIG_VERSION};
    if (H5Pget_mdc_config(list, &config) >= 0) {
        config.set_initial_size = true;
        config.initial_size = config.min_size = INDEX_CACHE;
        H5Pset_mdc_config(list, &config);
    }
}

// Chooses the earliest file format, which stays readable when its writer is killed, and strong
// closing.
static hid_t file_access(void) {
    const hid_t list = H5Pcreate(H5P_FILE_ACCESS);
    if (list >= 0) {
        limit_index_cache(list);
        H5Pset_fclose_degree(list, H5F_CLOSE_STRONG);
        H5Pset_libver_bounds(list, H5F_LIBVER_EARLIEST, H5F_LIBVER_LATEST);
    }
    return list;
}

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
    pm_hdf5 *opened = handle_new(path, content);
    if (opened == NULL) {
        return pm_hdf5_fail_memory(path);
    }
    if (H5Fis_hdf5(path) <= 0) {
        pm_hdf5_close(opened);
        return pm_fail(PM_EFILE, "%s: not an HDF5 file", path);
    }
    const char *objection = source == PM_HDF5_OWN ? objection_to(path) : NULL;
    if (objection != NULL) {
        pm_hdf5_close(opened);
        return pm_fail(PM_EFILE, "%s: damaged, or not written by portmet: %s", path, objection);
    }
    const hid_t list = file_access();
    opened->file = H5Fopen(path, to_write ? H5F_ACC_RDWR : H5F_ACC_RDONLY, list);
    const pm_status status =
        opened->file < 0 ? pm_hdf5_fail(PM_EFILE, path, "open", "it as HDF5") : PM_OK;
    pm_hdf5_release(list);
    if (status != PM_OK) {
        pm_hdf5_close(opened);
        return status;
    }
    *file = opened;
    return PM_OK;
}

pm_status pm_hdf5_open(pm_hdf5 **file, const char *path, pm_hdf5_source source, pm_status content) {
    return open_as(file, path, source, content, false);
}

void pm_hdf5_end(void) {
    H5close();
}

pm_status pm_hdf5_reopen(pm_hdf5 **file, const char *path) {
    return open_as(file, path, PM_HDF5_ANY, PM_EFILE, true);
}

pm_status pm_hdf5_create(pm_hdf5 **file, const char *path, pm_hdf5_mode mode) {
    pm_hdf5 *created = handle_new(path, PM_EFILE);
    if (created == NULL) {
        return pm_hdf5_fail_memory(path);
    }
    unsigned flags = H5F_ACC_TRUNC;
    const char *name = path;
    if (mode == PM_HDF5_ATOMIC) {
        if (asprintf(&created->temporary, "%s.%ld.tmp", path, (long)getpid()) < 0) {
            created->temporary = NULL;
            pm_hdf5_close(created);
            return pm_hdf5_fail_memory(path);
        }
        // Exclusive creation never writes to a file or link of somebody else.
        name = created->temporary;
        flags = H5F_ACC_EXCL;
        unlink(name);
    }
    const hid_t list = file_access();
    created->file = H5Fcreate(name, flags, H5P_DEFAULT, list);
    const pm_status status =
        created->file < 0 ? pm_hdf5_fail(PM_EFILE, path, "create", "the file") : PM_OK;
    pm_hdf5_release(list);
    if (status != PM_OK) {
        pm_hdf5_close(created);
        return status;
    }
    *file = created;
    return PM_OK;
}

pm_status pm_hdf5_flush(pm_hdf5 *file) {
    hsize_t end = 0;
    if (H5Fflush(file->file, H5F_SCOPE_LOCAL) < 0 || H5Fget_filesize(file->file, &end) < 0) {
        return pm_hdf5_fail_write(file, "/");
    }
    // The library has cut off what was reserved beyond the end.
    file->reserved = (int64_t)end < file->reserved ? (int64_t)end : file->reserved;
    return PM_OK;
}

bool pm_hdf5_is_broken(const pm_hdf5 *file) {
    return file->broken;
}

static pm_status sync_file(const char *name, const char *path) {
    const int descriptor = open(name, O_RDONLY | O_CLOEXEC);
    const int failed = descriptor < 0 || fsync(descriptor) != 0;
    const int cause = errno;
    if (descriptor >= 0) {
        close(descriptor);
    }
    return failed ? pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(cause)) : PM_OK;
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
        return pm_hdf5_fail_write(file, "/");
    }
    trim(file);
    if (file->temporary != NULL) {
        PM_TRY(sync_file(file->temporary, file->path));
        if (rename(file->temporary, file->path) != 0) {
            return pm_fail(PM_EFILE, "%s: cannot be written: %s", file->path, strerror(errno));
        }
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
    pm_hdf5_release(file->access);
    if (file->temporary != NULL) {
        unlink(file->temporary);
        free(file->temporary);
    }
    free(file->path);
    free(file);
}

// --- names ---

static ssize_t name_at(const pm_hdf5 *file, const char *object, bool attribute, hsize_t i,
                       char *name) {
    return attribute ? H5Aget_name_by_idx(file->file, object, H5_INDEX_NAME, H5_ITER_INC, i, name,
                                          PM_HDF5_NAME_SIZE, file->access)
                     : H5Lget_name_by_idx(file->file, object, H5_INDEX_NAME, H5_ITER_INC, i, name,
                                          PM_HDF5_NAME_SIZE, file->access);
}

static pm_status list_names(const pm_hdf5 *file, const char *object, bool attribute,
                            pm_arena *arena, int *count, const char ***name) {
    char text[PM_HDF5_NAME_SIZE];
    int n = 0;
    while (n < PM_HDF5_MAX_NAMES && name_at(file, object, attribute, (hsize_t)n, text) >= 0) {
        ++n;
    }
    if (n == PM_HDF5_MAX_NAMES) {
        return pm_fail(file->content, "%s: %s has more than %d entries", file->path, object, n - 1);
    }
    const char **list = pm_arena_array(arena, (size_t)n, sizeof *list);
    for (int i = 0; list != NULL && i < n; ++i) {
        name_at(file, object, attribute, (hsize_t)i, text);
        list[i] = pm_arena_strdup(arena, text);
        list = list[i] == NULL ? NULL : list;
    }
    if (list == NULL) {
        return pm_hdf5_fail_memory(file->path);
    }
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
