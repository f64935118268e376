// The HDF5 recording of a run. Every quantity is a series of its own with a buffer.
// The buffers are written when a block is full or a second has passed, so that a step costs one
// copy. Space on the disk is reserved before, so that a write does not fail halfway.
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
#include "store/hdf5_io.h"

#define BLOCK 256         // samples in a buffer and in a chunk of the file
#define CHUNK 131072      // most numbers of a chunk: large states have fewer samples in it
#define FLUSH_SECONDS 1.0 // of samples that a killed run may lose
#define FORMAT "portmet recording"
#define MAX_NAMED 1000   // components whose names fit into an attribute of 64 KiB
#define INDEX_BYTES 8192 // most by which a block makes the file's index of a series grow

// --- the recording ---

// One series of the file.
typedef struct series_column {
    const char *path, *unit; // unit NULL: none is written
    int width;               // 0: one number per sample
    pm_hdf5_series series;
    double *buffer; // [BLOCK][width or 1]
    int count;      // numbers per sample
    int rows;       // samples in a chunk of the file
} series_column;

struct pm_recording {
    pm_arena arena;
    pm_hdf5 *file;
    const char *path;
    const pm_scene *scene;
    int ncolumn;
    series_column *column; // in the order in which put_sample fills them
    int buffered;          // samples
    double flushed;        // s, pm_clock
    int64_t block;         // bytes by which the file grows at most when the buffers are written
    int64_t pending;       // such bytes since the last flush
    int64_t written;       // samples handed to the file
    int64_t committed;     // samples that are certain
    bool failed;           // a write has failed
};

#define SCENE_COLUMNS 6
#define SUBSYSTEM_COLUMNS 5
#define PORT_COLUMNS 4

static pm_status fail_memory(void) {
    return pm_fail(PM_ENOMEM, "recording: out of memory");
}

// Adds the series /`folder`/`name` to the list.
static pm_status add(pm_recording *r, const char *folder, const char *name, int width,
                     const char *unit) {
    series_column *c = &r->column[r->ncolumn++];
    c->path = pm_arena_printf(&r->arena, "%s/%s", folder, name);
    c->unit = unit;
    c->width = width;
    c->count = width == 0 ? 1 : width;
    c->rows = c->count <= CHUNK / BLOCK ? BLOCK : 1 + (CHUNK - 1) / c->count;
    // A block fills its share of chunks, and may begin one more.
    r->block += ((int64_t)c->count * (BLOCK + c->rows)) * (int64_t)sizeof *c->buffer + INDEX_BYTES;
    c->buffer = pm_arena_array(&r->arena, (size_t)c->count * BLOCK, sizeof *c->buffer);
    return c->path == NULL || c->buffer == NULL ? fail_memory() : PM_OK;
}

// Writes names and units of the components of z: "s", or "q[0]" in a group of several. Where there
// are too many components for an attribute, writes those of the groups: "q[0:5000]".
static pm_status describe_state(pm_recording *r, const char *path,
                                const pm_scene_subsystem *subsystem) {
    const pm_layout *layout = &subsystem->layout;
    const bool whole = layout->nz > MAX_NAMED;
    const size_t capacity = (size_t)(whole ? layout->ngroup : layout->nz);
    const char **name = pm_arena_array(&r->arena, capacity, sizeof *name);
    const char **unit = pm_arena_array(&r->arena, capacity, sizeof *unit);
    if (name == NULL || unit == NULL) {
        return fail_memory();
    }
    int count = 0;
    for (int g = 0; g < layout->ngroup; ++g) {
        const pm_group *group = &layout->group[g];
        for (int i = 0; i < (whole ? 1 : group->size); ++i, ++count) {
            name[count] = group->size == 1 ? group->name
                          : whole ? pm_arena_printf(&r->arena, "%s[0:%d]", group->name, group->size)
                                  : pm_arena_printf(&r->arena, "%s[%d]", group->name, i);
            unit[count] = group->unit;
            if (name[count] == NULL) {
                return fail_memory();
            }
        }
    }
    PM_TRY(pm_hdf5_write_texts(r->file, path, "variables", count, name));
    return pm_hdf5_write_texts(r->file, path, "units", count, unit);
}

static pm_status add_subsystem(pm_recording *r, const pm_scene_subsystem *subsystem) {
    const char *folder = pm_arena_printf(&r->arena, "/subsystems/%s", subsystem->name);
    if (folder == NULL) {
        return fail_memory();
    }
    PM_TRY(add(r, folder, "z", subsystem->layout.nz, NULL));
    PM_TRY(add(r, folder, "E", 0, "J"));
    PM_TRY(add(r, folder, "S", 0, "J/K"));
    PM_TRY(add(r, folder, "bulk_energy", 0, "W"));
    return add(r, folder, "bulk_entropy", 0, "W/K");
}

static pm_status add_port(pm_recording *r, const pm_scene_port *port) {
    const char *folder = pm_arena_printf(&r->arena, "/ports/%s", port->name);
    if (folder == NULL) {
        return fail_memory();
    }
    PM_TRY(add(r, folder, "energy_flux_a", 0, "W"));
    PM_TRY(add(r, folder, "energy_flux_b", 0, "W"));
    PM_TRY(add(r, folder, "entropy_flux_a", 0, "W/K"));
    return add(r, folder, "entropy_flux_b", 0, "W/K");
}

static pm_status add_all(pm_recording *r) {
    const pm_scene *scene = r->scene;
    PM_TRY(add(r, "", "time", 0, "s"));
    PM_TRY(add(r, "", "step", 0, NULL));
    PM_TRY(add(r, "/ledger", "energy", 0, "J"));
    PM_TRY(add(r, "/ledger", "entropy", 0, "J/K"));
    PM_TRY(add(r, "/ledger", "energy_residual", 0, "1"));
    PM_TRY(add(r, "/ledger", "entropy_residual", 0, "1"));
    for (int i = 0; i < scene->nsubsystem; ++i) {
        PM_TRY(pm_scene_records(scene, i) ? add_subsystem(r, &scene->subsystem[i]) : PM_OK);
    }
    for (int i = 0; i < scene->nport; ++i) {
        PM_TRY(pm_scene_records_port(scene, i) ? add_port(r, &scene->port[i]) : PM_OK);
    }
    for (int i = 0; i < scene->nlive_input; ++i) {
        const pm_scene_live_input *input = &scene->live_input[i];
        for (int k = 0; k < input->count; ++k) {
            PM_TRY(add(r, "/live", input->name[k], 0, NULL));
        }
    }
    return PM_OK;
}

static pm_status describe_port(pm_recording *r, const pm_scene_port *port) {
    const char *folder = pm_arena_printf(&r->arena, "/ports/%s", port->name);
    const char *const ends[2] = {pm_scene_end_name(r->scene, port, 0),
                                 pm_scene_end_name(r->scene, port, 1)};
    return folder == NULL ? fail_memory() : pm_hdf5_write_texts(r->file, folder, "ends", 2, ends);
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
    for (int i = 0; i < r->ncolumn; ++i) {
        series_column *c = &r->column[i];
        PM_TRY(pm_hdf5_series_create(&c->series, r->file, c->path, c->width, c->rows,
                                     strcmp(c->path, "/step") == 0));
        if (c->unit != NULL) {
            PM_TRY(pm_hdf5_write_text(r->file, c->path, "units", c->unit));
        }
    }
    for (int i = 0, state = SCENE_COLUMNS; i < scene->nsubsystem; ++i) {
        if (pm_scene_records(scene, i)) {
            PM_TRY(describe_state(r, r->column[state].path, &scene->subsystem[i]));
            state += SUBSYSTEM_COLUMNS;
        }
    }
    for (int i = 0; i < scene->nport; ++i) {
        PM_TRY(pm_scene_records_port(scene, i) ? describe_port(r, &scene->port[i]) : PM_OK);
    }
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
    for (int i = 0; i < r->ncolumn; ++i) {
        series_column *c = &r->column[i];
        PM_TRY(pm_hdf5_series_open(&c->series, r->file, c->path, c->width, c->rows, count));
    }
    return PM_OK;
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

static size_t count_columns(const pm_scene *scene) {
    size_t count = SCENE_COLUMNS;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        count += pm_scene_records(scene, i) ? SUBSYSTEM_COLUMNS : 0;
    }
    for (int i = 0; i < scene->nport; ++i) {
        count += pm_scene_records_port(scene, i) ? PORT_COLUMNS : 0;
    }
    return count + (size_t)scene->nlive;
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
    r->column = pm_arena_array(&r->arena, count_columns(scene), sizeof *r->column);
    r->path = pm_arena_strdup(&r->arena, path);
    if (r->column == NULL || r->path == NULL) {
        status = fail_memory();
        goto done;
    }
    PM_TRY_DONE(add_all(r));
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

// Copies this sample's numbers of the next column into its buffer.
static void put(const pm_recording *r, int *next, const double *value) {
    const series_column *c = &r->column[(*next)++];
    const size_t count = (size_t)c->count;
    memcpy(c->buffer + (size_t)r->buffered * count, value, count * sizeof *value);
}

static void put_one(const pm_recording *r, int *next, double value) {
    put(r, next, &value);
}

static double total(int n, const double *value) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += value[i];
    }
    return sum;
}

static void put_sample(const pm_recording *r, const pm_sample *s) {
    const pm_scene *scene = r->scene;
    int next = 0;
    put_one(r, &next, s->time);
    put_one(r, &next, (double)s->step);
    put_one(r, &next, s->outside_energy + total(scene->nsubsystem, s->energy));
    put_one(r, &next, s->outside_entropy + total(scene->nsubsystem, s->entropy));
    put_one(r, &next, s->energy_residual);
    put_one(r, &next, s->entropy_residual);
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (!pm_scene_records(scene, i)) {
            continue;
        }
        put(r, &next, s->z + scene->subsystem[i].first);
        put_one(r, &next, s->energy[i]);
        put_one(r, &next, s->entropy[i]);
        put_one(r, &next, s->bulk_energy[i]);
        put_one(r, &next, s->bulk_entropy[i]);
    }
    for (int i = 0; i < scene->nport; ++i) {
        if (!pm_scene_records_port(scene, i)) {
            continue;
        }
        put_one(r, &next, s->flux[i][0].energy);
        put_one(r, &next, s->flux[i][1].energy);
        put_one(r, &next, s->flux[i][0].entropy);
        put_one(r, &next, s->flux[i][1].entropy);
    }
    for (int i = 0; i < scene->nlive; ++i) {
        put_one(r, &next, s->live[i]);
    }
}

// Flushes the samples that the file has been handed, and then says that they are certain.
static pm_status commit(pm_recording *r) {
    PM_TRY(pm_hdf5_flush(r->file));
    r->pending = 0;
    return set_committed(r, r->written);
}

// Makes sure that there is space for another block.
static pm_status reserve_block(pm_recording *r) {
    if (pm_hdf5_reserve(r->file, r->pending + r->block) != PM_OK) {
        // The blocks before this one have their space. After a flush it is known how much they
        // need.
        PM_TRY(commit(r));
        PM_TRY(pm_hdf5_reserve(r->file, r->block));
    }
    r->pending += r->block;
    return PM_OK;
}

static pm_status write_buffers(pm_recording *r) {
    if (r->buffered == 0) {
        return PM_OK;
    }
    PM_TRY(reserve_block(r));
    for (int i = 0; i < r->ncolumn; ++i) {
        PM_TRY(pm_hdf5_series_append(&r->column[i].series, r->buffered, r->column[i].buffer));
    }
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
    put_sample(recording, sample);
    ++recording->buffered;
    if (pm_clock() - recording->flushed >= FLUSH_SECONDS) {
        return pm_recording_flush(recording);
    }
    return recording->buffered == BLOCK ? note(recording, write_buffers(recording)) : PM_OK;
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
