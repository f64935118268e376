#include "base/files.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

// A file. The inode of one that is gone may be that of a later one, which has another time of
// birth.
typedef struct identity {
    dev_t device;
    ino_t inode;
    struct timespec born; // zero where the file system does not tell
    bool written;         // by the program
} identity;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static identity *known;
static size_t nknown, capacity;

// Returns whether there is something at `path`, and what.
static bool identify(const char *path, identity *own, struct stat *facts) {
    struct statx more;
    if (stat(path, facts) != 0) {
        return false;
    }
    *own = (identity){.device = facts->st_dev, .inode = facts->st_ino};
    if (statx(AT_FDCWD, path, 0, STATX_BTIME, &more) == 0 && (more.stx_mask & STATX_BTIME) != 0) {
        own->born = (struct timespec){more.stx_btime.tv_sec, more.stx_btime.tv_nsec};
    }
    return true;
}

// Returns what is known of a file; NULL: nothing. The caller holds the lock.
static identity *find(const identity *own) {
    for (size_t i = 0; i < nknown; ++i) {
        if (known[i].device == own->device && known[i].inode == own->inode &&
            known[i].born.tv_sec == own->born.tv_sec &&
            known[i].born.tv_nsec == own->born.tv_nsec) {
            return &known[i];
        }
    }
    return NULL;
}

// Notes a file. Without memory for it, the file is not protected.
static void note(const char *path, bool written) {
    struct stat facts;
    identity own;
    if (!identify(path, &own, &facts)) {
        return;
    }
    own.written = written;
    pthread_mutex_lock(&lock);
    identity *found = find(&own);
    if (found == NULL && nknown == capacity) {
        const size_t more = 2 * capacity + 16;
        identity *larger = realloc(known, more * sizeof *known);
        known = larger == NULL ? known : larger;
        capacity = larger == NULL ? capacity : more;
    }
    if (found == NULL && nknown < capacity) {
        known[nknown++] = own;
    } else if (found != NULL) {
        found->written = found->written || written;
    }
    pthread_mutex_unlock(&lock);
}

pm_status pm_files_check_input(const char *path) {
    struct stat facts;
    const bool special =
        stat(path, &facts) == 0 && !S_ISREG(facts.st_mode) && !S_ISDIR(facts.st_mode);
    return special ? pm_fail(PM_EFILE, "%s: this is not a regular file, and is not read", path)
                   : PM_OK;
}

void pm_files_note_input(const char *path) {
    note(path, false);
}

void pm_files_note_output(const char *path) {
    note(path, true);
}

// Returns true if there is nothing in the file, or it is of this kind. The HDF5 library is not
// asked: it may crash on what a killed run left.
static bool is_of_kind(const char *path, const char *kind) {
    static const char hdf5[] = PM_FILES_HDF5;
    static const char *const own[] = {PM_FILES_WEIGHTS, PM_FILES_RECORDING};
    char start[16384];
    FILE *file = fopen(path, "rb");
    const size_t size = file == NULL ? 0 : fread(start, 1, sizeof start, file);
    if (file != NULL) {
        fclose(file);
    }
    const char *found = size < strlen(hdf5) || memcmp(start, hdf5, strlen(hdf5)) != 0 ? NULL : hdf5;
    for (int i = 0; i < 2 && found != NULL; ++i) {
        found = memmem(start, size, own[i], strlen(own[i])) != NULL ? own[i] : found;
    }
    const bool begins = size >= strlen(kind) && memcmp(start, kind, strlen(kind)) == 0;
    if (strcmp(kind, PM_FILES_PICTURE) == 0) {
        return size == 0 || memmem(start, size, kind, strlen(kind)) != NULL;
    }
    return size == 0 || (found == NULL || *kind == '\0' ? begins : strcmp(kind, found) == 0);
}

pm_status pm_files_check_output(const char *path, const char *kind) {
    struct stat facts;
    identity own;
    const bool link = lstat(path, &facts) == 0 && S_ISLNK(facts.st_mode);
    const bool there = identify(path, &own, &facts);
    pthread_mutex_lock(&lock);
    const identity *found = there ? find(&own) : NULL;
    const bool input = found != NULL && !found->written;
    pthread_mutex_unlock(&lock);
    if (input) {
        return pm_fail(PM_EUSAGE, "%s: the program reads this file, and does not overwrite it",
                       path);
    }
    if (kind != NULL && link) {
        return pm_fail(PM_EFILE, "%s: this is a symbolic link, and is not replaced", path);
    }
    if (kind != NULL && there && !S_ISREG(facts.st_mode)) {
        return pm_fail(PM_EFILE, "%s: this is not a regular file, and is not replaced", path);
    }
    return kind == NULL || !there || is_of_kind(path, kind)
               ? PM_OK
               : pm_fail(PM_EFILE,
                         "%s: this file exists and is of another kind: remove it, or choose "
                         "another name",
                         path);
}

pm_status pm_files_create(FILE **file, const char *path, const char *kind) {
    PM_TRY(pm_files_check_output(path, kind));
    *file = fopen(path, "w");
    if (*file == NULL) {
        return pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    pm_files_note_output(path);
    return PM_OK;
}
