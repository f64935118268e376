// The HDF5 recording of a run. Its series have buffers (recording_series.h), which are written when
// a block is full or a second has passed, so that a step costs one copy. Space on the disk is
// reserved before, so that a write does not fail halfway.
#include "scene/recording.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/attempt.h"
#include "base/progress.h"
#include "scene/recording_series.h"
#include "store/hdf5_io.h"

#define FLUSH_SECONDS 1.0 // of samples that a killed run may lose
#define FORMAT "portmet recording"

// --- the recording ---

struct pm_recording {
    pm_arena arena;
    pm_hdf5 *file;
    const char *path;
    const pm_scene *scene;
    pm_recorded_list list;
    int buffered;      // samples
    double flushed;    // s, pm_clock
    int64_t pending;   // bytes by which the file may have grown since the last flush
    int64_t written;   // samples handed to the file
    int64_t committed; // samples that are certain
    bool failed;       // a write has failed
};

static pm_status fail_memory(void) {
    return pm_fail(PM_ENOMEM, "recording: out of memory");
}

static pm_status create_all(pm_recording *r) {
    const pm_scene *scene = r->scene;
    PM_TRY(pm_hdf5_write_text(r->file, "/", "format", FORMAT));
    PM_TRY(pm_hdf5_write_integer(r->file, "/", "version", 2));
    PM_TRY(pm_hdf5_write_integer(r->file, "/", "committed", 0));
    PM_TRY(pm_hdf5_write_text(r->file, "/", "scene", scene->name));
    PM_TRY(pm_hdf5_write_text(r->file, "/", "integrator", scene->integrator->name));
    PM_TRY(pm_hdf5_write_integer(r->file, "/", "substeps", (uint64_t)scene->substeps));
    PM_TRY(pm_hdf5_write_number(r->file, "/", "dt", scene->dt));
    PM_TRY(pm_recorded_list_create(&r->list, r->file));
    return pm_hdf5_flush(r->file);
}

// Writes down how many samples are certain.
static pm_status set_committed(pm_recording *r, int64_t count) {
    if (count != r->committed) {
        PM_TRY(pm_hdf5_update_integer(r->file, "/", "committed", (uint64_t)count));
        PM_TRY(pm_hdf5_flush(r->file));
        r->committed = count;
    }
    return PM_OK;
}

static pm_status open_all(pm_recording *r, long count) {
    uint64_t committed;
    PM_TRY(pm_hdf5_read_integer(r->file, "/", "committed", &committed));
    if (committed < (uint64_t)count) {
        return pm_fail(PM_EFILE, "%s: %" PRIu64 " samples are certain, expected %ld to go on with",
                       r->path, committed, count);
    }
    r->committed = (int64_t)committed;
    r->written = count;
    // The number comes first: whoever dies in between leaves more rows than are certain, not fewer.
    PM_TRY(set_committed(r, count));
    return pm_recorded_list_open(&r->list, r->file, count);
}

// Returns the folder of `path`, which the caller frees. NULL: out of memory.
static char *folder_of(const char *path) {
    const char *slash = strrchr(path, '/');
    if (slash == NULL) {
        return strdup(".");
    }
    return slash == path ? strdup("/") : strndup(path, (size_t)(slash - path));
}

static pm_status check_folder(const char *path) {
    char *folder = folder_of(path);
    if (folder == NULL) {
        return fail_memory();
    }
    pm_status status = PM_OK;
    if (access(folder, W_OK | X_OK) != 0) {
        status = pm_fail(PM_EFILE, "%s: cannot create a recording: folder %s: %s", path, folder,
                         strerror(errno));
    }
    free(folder);
    return status;
}

// Returns true if the file at `path` is an HDF5 file whose beginning holds the format's name, which
// is the first attribute of a recording. The HDF5 library is not asked: it may crash on what a
// killed run left.
static bool is_recording(const char *path) {
    static const char signature[] = "\x89HDF\r\n\x1a\n";
    char start[16384];
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return false;
    }
    const size_t size = fread(start, 1, sizeof start, file);
    fclose(file);
    return size >= sizeof signature - 1 && memcmp(start, signature, sizeof signature - 1) == 0 &&
           memmem(start, size, FORMAT, sizeof FORMAT - 1) != NULL;
}

pm_status pm_recording_check(const char *path, bool overwrite) {
    struct stat there;
    if (stat(path, &there) != 0) {
        return *path == 0 ? pm_fail(PM_EFILE, "a recording needs a name") : check_folder(path);
    }
    if (!S_ISREG(there.st_mode)) {
        return pm_fail(PM_EFILE, "%s: cannot create a recording: this is not a file", path);
    }
    if (access(path, W_OK) != 0) {
        return pm_fail(PM_EFILE, "%s: cannot be overwritten: %s", path, strerror(errno));
    }
    if (!overwrite && there.st_size > 0 && !is_recording(path)) {
        return pm_fail(PM_EFILE, "%s: this file exists and is not a recording", path);
    }
    return PM_OK;
}

// Opens a new file, or with `count` >= 0 an existing one that holds at least as many samples.
static pm_status open_at(pm_recording **recording, const char *path, const pm_scene *scene,
                         long count) {
    pm_recording *r = calloc(1, sizeof *r);
    if (r == NULL) {
        return fail_memory();
    }
    pm_status status;
    r->scene = scene;
    r->path = pm_arena_strdup(&r->arena, path);
    PM_TRY_DONE(r->path == NULL ? fail_memory() : PM_OK);
    PM_TRY_DONE(pm_recorded_list_init(&r->list, &r->arena, scene));
    PM_TRY_DONE(count < 0 ? pm_hdf5_create(&r->file, path, PM_HDF5_IN_PLACE)
                          : pm_hdf5_reopen(&r->file, path));
    PM_TRY_DONE(count < 0 ? create_all(r) : open_all(r, count));
    r->flushed = pm_clock();
    *recording = r;
    return PM_OK;
done:
    pm_hdf5_close(r->file);
    pm_arena_free(&r->arena);
    free(r);
    return status;
}

pm_status pm_recording_open(pm_recording **recording, const char *path, const pm_scene *scene) {
    return open_at(recording, path, scene, -1);
}

typedef struct reopening {
    const char *path;
    const pm_scene *scene;
    long count;
} reopening;

static void try_reopen(const void *context) {
    const reopening *what = context;
    pm_recording *recording = NULL;
    if (open_at(&recording, what->path, what->scene, what->count) == PM_OK) {
        pm_recording_close(recording);
    }
    pm_hdf5_end();
}

// The HDF5 library may crash on a file that its writer did not close. A child process therefore
// opens the file first.
pm_status pm_recording_reopen(pm_recording **recording, const char *path, const pm_scene *scene,
                              long count) {
    const reopening context = {path, scene, count};
    char what[512];
    snprintf(what, sizeof what, "%s: damaged: the HDF5 library crashes on it", path);
    PM_TRY(pm_attempt(try_reopen, &context, PM_EFILE, what));
    return open_at(recording, path, scene, count);
}

// --- appending ---

// Flushes the samples that the file has been handed, and then says that they are certain.
static pm_status commit(pm_recording *r) {
    PM_TRY(pm_hdf5_flush(r->file));
    r->pending = 0;
    return set_committed(r, r->written);
}

// Makes sure that there is space for another block.
static pm_status reserve_block(pm_recording *r) {
    if (pm_hdf5_reserve(r->file, r->pending + r->list.bytes) != PM_OK) {
        // The blocks before this one have their space. After a flush it is known how much they
        // need.
        PM_TRY(commit(r));
        PM_TRY(pm_hdf5_reserve(r->file, r->list.bytes));
    }
    r->pending += r->list.bytes;
    return PM_OK;
}

static pm_status write_buffers(pm_recording *r) {
    if (r->buffered == 0) {
        return PM_OK;
    }
    PM_TRY(reserve_block(r));
    PM_TRY(pm_recorded_list_append(&r->list, r->buffered));
    r->written += r->buffered;
    r->buffered = 0;
    return PM_OK;
}

// Passes a status on. On the first failure adds to its description what is left of the recording.
static pm_status note(pm_recording *r, pm_status status) {
    if (status == PM_OK || r->failed) {
        return status;
    }
    r->failed = true;
    char cause[256];
    snprintf(cause, sizeof cause, "%s", pm_error());
    return pm_hdf5_is_broken(r->file)
               ? pm_fail(status, "%s; the recording may be damaged", cause)
               : pm_fail(status, "%s; the first %" PRId64 " samples are certain", cause,
                         r->committed);
}

static pm_status fail_again(const pm_recording *r) {
    return pm_fail(PM_EFILE, "%s: writing has failed before", r->path);
}

pm_status pm_recording_append(pm_recording *recording, const pm_sample *sample) {
    if (recording->failed) {
        return fail_again(recording);
    }
    pm_recorded_list_put(&recording->list, recording->buffered, sample);
    ++recording->buffered;
    if (pm_clock() - recording->flushed >= FLUSH_SECONDS) {
        return pm_recording_flush(recording);
    }
    return recording->buffered == recording->list.depth ? note(recording, write_buffers(recording))
                                                        : PM_OK;
}

pm_status pm_recording_flush(pm_recording *recording) {
    if (recording->failed) {
        return fail_again(recording);
    }
    recording->flushed = pm_clock();
    PM_TRY(note(recording, write_buffers(recording)));
    return note(recording, commit(recording));
}

pm_status pm_recording_close(pm_recording *recording) {
    if (recording == NULL) {
        return PM_OK;
    }
    pm_status status = PM_OK;
    if (!recording->failed) {
        PM_TRY_DONE(pm_recording_flush(recording));
        status = note(recording, pm_hdf5_commit(recording->file));
    }
done:
    pm_hdf5_close(recording->file);
    pm_arena_free(&recording->arena);
    free(recording);
    return status;
}
