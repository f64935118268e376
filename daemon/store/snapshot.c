// A snapshot is a head, the numbers, and a digest of both.
#include "store/snapshot.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/digest.h"

#define MAGIC "portmet snapshot 1\n"

typedef struct head {
    char magic[24];
    uint64_t digest;
    int64_t session, count;
} head;

static uint64_t check_sum(const head *h, const double *value) {
    uint64_t sum = pm_digest_integer(PM_DIGEST_INIT, (int64_t)h->digest);
    sum = pm_digest_integer(sum, h->session);
    return pm_digest_doubles(sum, value, (size_t)h->count);
}

static pm_status fail(const char *path, const char *what) {
    return pm_fail(PM_EFILE, "%s: cannot %s a snapshot: %s", path, what, strerror(errno));
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

static bool write_all(int file, const head *h, const double *value) {
    const uint64_t sum = check_sum(h, value);
    return write_bytes(file, h, sizeof *h) &&
           write_bytes(file, value, (size_t)h->count * sizeof *value) &&
           write_bytes(file, &sum, sizeof sum);
}

pm_status pm_snapshot_save(const char *path, uint64_t digest, int64_t session, int count,
                           const double *value) {
    char temporary[4096];
    if (snprintf(temporary, sizeof temporary, "%s.tmp", path) >= (int)sizeof temporary) {
        return pm_fail(PM_EFILE, "%.64s...: the path of a snapshot is too long", path);
    }
    // Not by stdio, which would allocate a buffer within the step loop.
    const int file = open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (file < 0) {
        return fail(path, "write");
    }
    const head h = {MAGIC, digest, session, count};
    const bool written = write_all(file, &h, value);
    if ((close(file) != 0) || !written || rename(temporary, path) != 0) {
        const pm_status status = fail(path, "write");
        unlink(temporary);
        return status;
    }
    return PM_OK;
}

static pm_status read_head(const char *path, FILE *file, uint64_t digest, head *h) {
    if (fread(h, sizeof *h, 1, file) != 1 || strncmp(h->magic, MAGIC, sizeof h->magic) != 0) {
        return pm_fail(PM_EFILE, "%s: not a snapshot", path);
    }
    if (h->digest != digest) {
        return pm_fail(PM_EFILE,
                       "%s: a snapshot of %016" PRIx64 ", expected %016" PRIx64
                       ": scene, weights or initial state have changed; remove it to begin anew",
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

static pm_status damaged(const char *path) {
    return pm_fail(PM_EFILE,
                   "%s: a damaged snapshot, or one of another number of steps; remove it "
                   "to begin anew",
                   path);
}

static pm_status read_all(const char *path, FILE *file, uint64_t digest, head *h, int count,
                          double *value) {
    uint64_t sum;
    PM_TRY(read_head(path, file, digest, h));
    if (h->count != count || fread(value, sizeof *value, (size_t)count, file) != (size_t)count ||
        fread(&sum, sizeof sum, 1, file) != 1 || sum != check_sum(h, value) ||
        !all_finite(value, count)) {
        return damaged(path);
    }
    return PM_OK;
}

// NULL with PM_OK: there is none.
static pm_status open_file(const char *path, FILE **file) {
    *file = fopen(path, "rbe");
    return *file != NULL || errno == ENOENT ? PM_OK : fail(path, "read");
}

pm_status pm_snapshot_session(const char *path, uint64_t digest, int64_t *session, bool *found) {
    FILE *file;
    PM_TRY(open_file(path, &file));
    *found = file != NULL;
    if (file == NULL) {
        return PM_OK;
    }
    head h;
    const pm_status status = read_head(path, file, digest, &h);
    fclose(file);
    if (status == PM_OK) {
        *session = h.session;
    }
    return status;
}

pm_status pm_snapshot_load(const char *path, uint64_t digest, int64_t *session, int count,
                           double *value, bool *found) {
    FILE *file;
    PM_TRY(open_file(path, &file));
    *found = file != NULL;
    if (file == NULL) {
        return PM_OK;
    }
    head h;
    pm_status status = PM_OK;
    double *read = calloc((size_t)count + 1, sizeof *read);
    if (read == NULL) {
        status = pm_fail(PM_ENOMEM, "%s: out of memory", path);
        goto done;
    }
    PM_TRY_DONE(read_all(path, file, digest, &h, count, read));
    memcpy(value, read, (size_t)count * sizeof *value);
    *session = h.session;
done:
    free(read);
    fclose(file);
    return status;
}
