// Snapshots by plain system calls: the numbers are written under another name and renamed.
#include "store/snapshot.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/digest.h"

#define MAGIC "portmet snapshot 2\n"

typedef struct snapshot_head {
    char magic[24];
    uint64_t digest, layout;
    int64_t session, count;
} snapshot_head;

static uint64_t check_sum(const snapshot_head *h, const double *value) {
    uint64_t sum = pm_digest_integer(PM_DIGEST_INIT, (int64_t)h->digest);
    sum = pm_digest_integer(sum, (int64_t)h->layout);
    sum = pm_digest_integer(sum, h->session);
    return pm_digest_doubles(sum, value, (size_t)h->count);
}

// --- writing ---

static pm_status fail_access(const char *path, const char *what) {
    return pm_fail(PM_EFILE, "%s: cannot %s the snapshot: %s", path, what, strerror(errno));
}

static bool write_bytes(int file, const void *data, size_t size) {
    const unsigned char *at = data;
    while (size > 0) {
        const ssize_t count = write(file, at, size);
        if (count < 0 && errno == EINTR) {
            continue;
        }
        if (count <= 0) {
            return false;
        }
        at += count;
        size -= (size_t)count;
    }
    return true;
}

static bool write_all(int file, const snapshot_head *h, const double *value) {
    const uint64_t sum = check_sum(h, value);
    return write_bytes(file, h, sizeof *h) &&
           write_bytes(file, value, (size_t)h->count * sizeof *value) &&
           write_bytes(file, &sum, sizeof sum);
}

static pm_status save(const char *path, const pm_snapshot_key *key, int64_t session,
                      const double *value, bool synced) {
    char temporary[4096];
    if (snprintf(temporary, sizeof temporary, "%s.tmp", path) >= (int)sizeof temporary) {
        return pm_fail(PM_EFILE, "%.64s...: the path of the snapshot is too long", path);
    }
    // What a process that was killed has left is removed. Exclusive creation never writes to a file
    // or link of somebody else. stdio would allocate a buffer within the step loop.
    unlink(temporary);
    const int file = open(temporary, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (file < 0) {
        return fail_access(path, "write");
    }
    const snapshot_head h = {MAGIC, key->digest, key->layout, session, key->count};
    const bool written = write_all(file, &h, value) && (!synced || fsync(file) == 0);
    if ((close(file) != 0) || !written || rename(temporary, path) != 0) {
        const pm_status status = fail_access(path, "write");
        unlink(temporary);
        return status;
    }
    return PM_OK;
}

pm_status pm_snapshot_save(const char *path, const pm_snapshot_key *key, int64_t session,
                           const double *value) {
    return save(path, key, session, value, false);
}

pm_status pm_snapshot_save_synced(const char *path, const pm_snapshot_key *key, int64_t session,
                                  const double *value) {
    return save(path, key, session, value, true);
}

// --- reading ---

static pm_status read_head(const char *path, FILE *file, uint64_t digest, snapshot_head *h) {
    if (fread(h, sizeof *h, 1, file) != 1 || strncmp(h->magic, MAGIC, sizeof h->magic) != 0) {
        return pm_fail(PM_EFILE, "%s: not a snapshot, or a snapshot of another version of portmet",
                       path);
    }
    if (h->digest != digest) {
        return pm_fail(PM_EFILE,
                       "%s: the snapshot belongs to %016" PRIx64 ", expected %016" PRIx64
                       ": its scene, weights, configuration or data have changed; remove it to "
                       "begin anew",
                       path, h->digest, digest);
    }
    return PM_OK;
}

static bool all_finite(const double *value, int count) {
    bool finite = true;
    for (int i = 0; i < count; ++i) {
        finite = finite && isfinite(value[i]);
    }
    return finite;
}

static pm_status read_all(const char *path, FILE *file, const pm_snapshot_key *key,
                          snapshot_head *h, double *value) {
    uint64_t sum;
    PM_TRY(read_head(path, file, key->digest, h));
    if (h->count != key->count || h->layout != key->layout) {
        return pm_fail(PM_EFILE,
                       "%s: the snapshot holds %" PRId64 " numbers, expected %d others: another "
                       "version of portmet wrote it, or it is damaged; remove it to begin anew",
                       path, h->count, key->count);
    }
    const size_t count = (size_t)key->count;
    if (fread(value, sizeof *value, count, file) != count ||
        fread(&sum, sizeof sum, 1, file) != 1 || sum != check_sum(h, value)) {
        return pm_fail(PM_EFILE, "%s: the snapshot is damaged; remove it to begin anew", path);
    }
    return all_finite(value, key->count)
               ? PM_OK
               : pm_fail(PM_EFILE,
                         "%s: the snapshot holds a number that is not finite; remove it to begin "
                         "anew",
                         path);
}

// Leaves `file` NULL and returns PM_OK where there is no file. Waits for nobody who would write to
// a pipe.
static pm_status open_file(const char *path, FILE **file) {
    struct stat facts;
    *file = NULL;
    const int descriptor = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (descriptor < 0) {
        return errno == ENOENT ? PM_OK : fail_access(path, "read");
    }
    if (fstat(descriptor, &facts) != 0 || !S_ISREG(facts.st_mode)) {
        close(descriptor);
        return pm_fail(PM_EFILE, "%s: expected a snapshot, found something that is not a file",
                       path);
    }
    *file = fdopen(descriptor, "rb");
    if (*file == NULL) {
        const pm_status status = fail_access(path, "read");
        close(descriptor);
        return status;
    }
    return PM_OK;
}

pm_status pm_snapshot_session(const char *path, uint64_t digest, int64_t *session, bool *found) {
    FILE *file;
    PM_TRY(open_file(path, &file));
    *found = file != NULL;
    if (file == NULL) {
        return PM_OK;
    }
    snapshot_head h;
    const pm_status status = read_head(path, file, digest, &h);
    fclose(file);
    if (status == PM_OK) {
        *session = h.session;
    }
    return status;
}

pm_status pm_snapshot_load(const char *path, const pm_snapshot_key *key, int64_t *session,
                           double *value, bool *found) {
    FILE *file;
    PM_TRY(open_file(path, &file));
    *found = file != NULL;
    if (file == NULL) {
        return PM_OK;
    }
    snapshot_head h;
    pm_status status = PM_OK;
    double *read = calloc((size_t)key->count + 1, sizeof *read);
    if (read == NULL) {
        status = pm_fail(PM_ENOMEM, "%s: out of memory for %d numbers", path, key->count);
        goto done;
    }
    PM_TRY_DONE(read_all(path, file, key, &h, read));
    memcpy(value, read, (size_t)key->count * sizeof *value);
    *session = h.session;
done:
    free(read);
    fclose(file);
    return status;
}
