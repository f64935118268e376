// Snapshots by plain system calls: the numbers are written under another name and renamed.
// Checkpoints put their fields into a serializer one after another.
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
#include "base/serializer.h"

#define MAGIC "portmet snapshot 3\n"

typedef struct snapshot_head {
    char magic[24];
    uint64_t digest, layout;
    int64_t session, count;
    char owner[PM_SNAPSHOT_OWNER]; // zeros follow the name
} snapshot_head;

static uint64_t check_sum(const snapshot_head *h, const double *value) {
    uint64_t sum = pm_digest_integer(PM_DIGEST_INIT, (int64_t)h->digest);
    sum = pm_digest_integer(sum, (int64_t)h->layout);
    sum = pm_digest_integer(sum, h->session);
    for (size_t i = 0; i < sizeof h->owner; ++i) {
        sum = pm_digest_integer(sum, h->owner[i]);
    }
    return pm_digest_doubles(sum, value, (size_t)h->count);
}

static void set_owner(snapshot_head *h, const pm_snapshot_key *key) {
    memset(h->owner, 0, sizeof h->owner);
    for (size_t i = 0; i + 1 < sizeof h->owner && key->owner[i] != '\0'; ++i) {
        h->owner[i] = key->owner[i];
    }
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
    snapshot_head h = {MAGIC, key->digest, key->layout, session, key->count, ""};
    set_owner(&h, key);
    const uint64_t sum = check_sum(&h, value);
    const bool written = write_bytes(file, &h, sizeof h) &&
                         write_bytes(file, value, (size_t)h.count * sizeof *value) &&
                         write_bytes(file, &sum, sizeof sum) && (!synced || fsync(file) == 0);
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

// --- reading ---

static pm_status read_head(const char *path, FILE *file, const pm_snapshot_key *key,
                           snapshot_head *h) {
    snapshot_head expected;
    if (fread(h, sizeof *h, 1, file) != 1 || strncmp(h->magic, MAGIC, sizeof h->magic) != 0) {
        return pm_fail(PM_EFILE, "%s: not a snapshot, or a snapshot of another version of portmet",
                       path);
    }
    set_owner(&expected, key);
    if (memcmp(h->owner, expected.owner, sizeof h->owner) != 0) {
        return pm_fail(PM_EFILE, "%s: the snapshot belongs to \"%.*s\", expected one of \"%s\"",
                       path, (int)sizeof h->owner - 1, h->owner, expected.owner);
    }
    if (h->digest != key->digest) {
        return pm_fail(PM_EFILE,
                       "%s: the snapshot belongs to %016" PRIx64 ", expected %016" PRIx64
                       ": its scene, weights, configuration or data have changed; remove it to "
                       "begin anew",
                       path, h->digest, key->digest);
    }
    return PM_OK;
}

// Opens a snapshot. If there is no file, `file` stays NULL and the result is PM_OK. A pipe is
// refused without waiting for its writer.
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

pm_status pm_snapshot_session(const char *path, const pm_snapshot_key *key, int64_t *session,
                              bool *found) {
    FILE *file;
    PM_TRY(open_file(path, &file));
    *found = file != NULL;
    if (file == NULL) {
        return PM_OK;
    }
    snapshot_head h;
    const pm_status status = read_head(path, file, key, &h);
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
    uint64_t sum;
    pm_status status = PM_OK;
    const size_t count = (size_t)key->count;
    double *read = calloc(count + 1, sizeof *read);
    PM_TRY_DONE(pm_allocated(read, "%d numbers of %s", key->count, path));
    PM_TRY_DONE(read_head(path, file, key, &h));
    if (h.count != key->count || h.layout != key->layout) {
        PM_TRY_DONE(
            pm_fail(PM_EFILE,
                    "%s: the snapshot holds %" PRId64 " numbers, expected %d others: other parts "
                    "shared the process, another version of portmet wrote it, or it is damaged; "
                    "remove it to begin anew",
                    path, h.count, key->count));
    }
    if (fread(read, sizeof *read, count, file) != count || fread(&sum, sizeof sum, 1, file) != 1 ||
        sum != check_sum(&h, read)) {
        PM_TRY_DONE(
            pm_fail(PM_EFILE, "%s: the snapshot is damaged; remove it to begin anew", path));
    }
    for (size_t i = 0; i < count; ++i) {
        if (!isfinite(read[i])) {
            PM_TRY_DONE(pm_fail(PM_EFILE,
                                "%s: the snapshot holds a number that is not finite; remove it to "
                                "begin anew",
                                path));
        }
    }
    memcpy(value, read, count * sizeof *value);
    *session = h.session;
done:
    free(read);
    fclose(file);
    return status;
}

// --- checkpoints ---

static void put_fields(pm_serializer *serializer, int nfield, const pm_checkpoint_field *field) {
    for (int i = 0; i < nfield; ++i) {
        pm_serializer_put(serializer, field[i].name, field[i].value, field[i].count);
    }
}

// Counts the numbers and allocates them; the caller frees. PM_ENOMEM.
static pm_status prepare(const char *path, const char *kind, uint64_t digest, int nfield,
                         const pm_checkpoint_field *field, pm_snapshot_key *key, double **number) {
    pm_serializer serializer = pm_serializer_count(kind);
    put_fields(&serializer, nfield, field);
    *key = (pm_snapshot_key){digest, serializer.layout, serializer.count, kind};
    *number = malloc(((size_t)serializer.count + 1) * sizeof **number);
    return pm_allocated(*number, "%d numbers of %s", serializer.count, path);
}

pm_status pm_checkpoint_save(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field) {
    pm_snapshot_key key;
    double *number;
    PM_TRY(prepare(path, kind, digest, nfield, field, &key, &number));
    pm_serializer serializer = pm_serializer_save(kind, number);
    put_fields(&serializer, nfield, field);
    const pm_status status = save(path, &key, 0, number, true);
    free(number);
    return status;
}

pm_status pm_checkpoint_load(const char *path, const char *kind, uint64_t digest, int nfield,
                             const pm_checkpoint_field *field) {
    pm_snapshot_key key;
    double *number;
    int64_t session;
    bool found;
    PM_TRY(prepare(path, kind, digest, nfield, field, &key, &number));
    pm_status status = pm_snapshot_load(path, &key, &session, number, &found);
    if (status == PM_OK && !found) {
        status = pm_fail(PM_EFILE, "%s: there is no checkpoint to go on from", path);
    }
    if (status == PM_OK) {
        pm_serializer serializer = pm_serializer_restore(kind, number);
        put_fields(&serializer, nfield, field);
    }
    free(number);
    return status;
}
