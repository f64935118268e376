// The HDF5 recording of a run. A sample fills the series in the order of their list: the scene, the
// families of subsystems, the families of ports, and the live inputs. Their buffers are written
// when a block is full or a second has passed, so that a step costs one copy. Space on the disk is
// reserved before, so that a write does not fail halfway.
#include "scene/recording.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/files.h"
#include "base/progress.h"
#include "base/reproducible_sum.h"
#include "store/hdf5_io.h"

#define FLUSH_SECONDS 1.0     // of samples that a killed run may lose
#define BLOCK 256             // most samples in a buffer and in a chunk of the file
#define CHUNK 131072          // most numbers of a chunk: large states have fewer samples in it
#define MOST_BUFFERED 8388608 // numbers in all buffers, unless a single sample has more
#define MAX_NAMED 1000        // components whose names fit into an attribute of 64 KiB
#define INDEX_BYTES 8192      // most by which a block makes the file's index of a series grow

// One series of the file.
typedef struct recorded_series {
    const char *path, *unit; // unit NULL: none is written
    int rank, extent[PM_HDF5_SERIES_RANK];
    int count;              // numbers per sample
    int rows;               // samples in a chunk of the file
    double *buffer;         // [depth][count]
    pm_hdf5_series in_file; // of the open file
} recorded_series;

struct pm_recording {
    pm_arena arena;
    pm_hdf5 *file;
    const char *path;
    const pm_scene *scene;
    pm_recorded_families families;
    int nseries;
    recorded_series *series; // [nseries] in the order in which a sample fills them
    int depth;               // samples in a buffer
    int64_t bytes;           // by which the file grows at most when the buffers are written
    int buffered;            // samples
    double flushed;          // s, pm_clock
    int64_t pending;         // bytes by which the file may have grown since the last flush
    int64_t written;         // samples handed to the file
    int64_t committed;       // samples that are certain
    bool failed;             // a write has failed
};

// The series of a subsystem beside its state z, and those of an end of a port.
static const struct {
    const char *name, *unit;
    size_t column; // of pm_sample
    bool whole;    // a column of long
    bool flows;    // a mean over the step before
} of_subsystem[] = {
#define NUMBER(type, name, series, unit)      \
    {series, unit, offsetof(pm_sample, name), \
     _Generic((type)0, long                   \
              : true, default                 \
              : false),                       \
     false},
#define BULK(member, name, series, unit) {series, unit, offsetof(pm_sample, name), false, true},
    PM_SUBSYSTEM_NUMBERS(NUMBER, BULK)};
static const struct {
    const char *name, *unit;
    size_t member; // of pm_flux
} of_end[] = {
#define END(member, name, series, unit) {series, unit, offsetof(pm_flux, member)},
    PM_END_NUMBERS(END)};
#define NSUBSYSTEM (sizeof of_subsystem / sizeof of_subsystem[0])
#define NEND (sizeof of_end / sizeof of_end[0])

// --- families ---

// Adds a member: to the last family if it is of the same range and all are recorded, or else as a
// family of its own. `last` is the range of the last member.
static void add_member(pm_recorded_family *family, int *count, int id, const char *name,
                       const char *range, const char **last) {
    if (range != NULL && range == *last) {
        ++family[*count - 1].count;
        return;
    }
    family[(*count)++] = (pm_recorded_family){
        .name = range != NULL ? range : name, .first = id, .count = 1, .is_range = range != NULL};
    *last = range;
}

pm_status pm_recorded_families_find(pm_recorded_families *families, pm_arena *arena,
                                    const pm_scene *scene) {
    const bool whole = scene->run.recorded == NULL;
    pm_recorded_families f = {
        .subsystem = pm_arena_array(arena, (size_t)scene->physics.nsubsystem, sizeof *f.subsystem),
        .port = pm_arena_array(arena, (size_t)scene->physics.nport, sizeof *f.port),
    };
    PM_TRY(pm_arena_status(arena, "a recording"));
    const char *last = NULL;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        if (pm_scene_records(scene, i)) {
            add_member(f.subsystem, &f.nsubsystem, i, scene->physics.subsystem[i].name,
                       whole ? scene->physics.subsystem[i].range : NULL, &last);
        }
    }
    last = NULL;
    for (int i = 0; i < scene->physics.nport; ++i) {
        if (pm_scene_records_port(scene, i)) {
            add_member(f.port, &f.nport, i, scene->physics.port[i].name,
                       whole ? scene->physics.port[i].range : NULL, &last);
        }
    }
    *families = f;
    return PM_OK;
}

// --- the list of series ---

// Adds the series `folder`/`name` whose samples have an extent for the members of a family that is
// a range, and another for the `width` variables of each (0: one number).
static void add(pm_recording *r, const char *folder, const char *name,
                const pm_recorded_family *family, int width, const char *unit) {
    recorded_series *s = &r->series[r->nseries++];
    s->path = pm_arena_printf(&r->arena, "%s/%s", folder, name);
    s->unit = unit;
    s->count = 1;
    if (family != NULL && family->is_range) {
        s->extent[s->rank++] = family->count;
        s->count *= family->count;
    }
    if (width > 0) {
        s->extent[s->rank++] = width;
        s->count *= width;
    }
    s->rows = s->count <= CHUNK / BLOCK ? BLOCK : 1 + (CHUNK - 1) / s->count;
}

// Lists the series of the scene and makes their buffers.
static pm_status list_series(pm_recording *r) {
    static const char *const of_scene[][3] = {{"", "time", "s"},
                                              {"", "step", NULL},
                                              {"/ledger", "energy", "J"},
                                              {"/ledger", "entropy", "J/K"},
                                              {"/ledger", "energy_residual", "1"},
                                              {"/ledger", "entropy_residual", "1"}};
    const size_t nscene = sizeof of_scene / sizeof of_scene[0];
    PM_TRY(pm_recorded_families_find(&r->families, &r->arena, r->scene));
    const size_t most = nscene + (NSUBSYSTEM + 1) * (size_t)r->families.nsubsystem +
                        2 * NEND * (size_t)r->families.nport + (size_t)r->scene->network.nlive;
    r->series = pm_arena_array(&r->arena, most, sizeof *r->series);
    PM_TRY(pm_arena_status(&r->arena, "a recording"));
    for (size_t i = 0; i < nscene; ++i) {
        add(r, of_scene[i][0], of_scene[i][1], NULL, 0, of_scene[i][2]);
    }
    for (int i = 0; i < r->families.nsubsystem; ++i) {
        pm_recorded_family *family = &r->families.subsystem[i];
        const char *folder = pm_arena_printf(&r->arena, "/subsystems/%s", family->name);
        family->state = r->nseries;
        add(r, folder, "z", family, r->scene->physics.subsystem[family->first].layout.nz, NULL);
        for (size_t k = 0; k < NSUBSYSTEM; ++k) {
            if (of_subsystem[k].name != NULL) {
                add(r, folder, of_subsystem[k].name, family, 0, of_subsystem[k].unit);
            }
        }
    }
    for (int i = 0; i < r->families.nport; ++i) {
        const pm_recorded_family *family = &r->families.port[i];
        const char *folder = pm_arena_printf(&r->arena, "/ports/%s", family->name);
        for (size_t k = 0; k < 2 * NEND; ++k) {
            if (of_end[k / 2].unit != NULL) {
                add(r, folder,
                    pm_arena_printf(&r->arena, "%s_%c", of_end[k / 2].name, k % 2 == 0 ? 'a' : 'b'),
                    family, 0, of_end[k / 2].unit);
            }
        }
    }
    for (int i = 0; i < r->scene->network.nlive_input; ++i) {
        const pm_scene_live_input *input = &r->scene->network.live_input[i];
        for (int k = 0; k < input->count; ++k) {
            add(r, "/live", input->name[k], NULL, 0, NULL);
        }
    }
    int64_t sample = 0;
    for (int i = 0; i < r->nseries; ++i) {
        sample += r->series[i].count;
    }
    const int64_t depth = MOST_BUFFERED / sample;
    r->depth = depth < 1 ? 1 : depth < BLOCK ? (int)depth : BLOCK;
    for (int i = 0; i < r->nseries; ++i) {
        recorded_series *s = &r->series[i];
        // The rows of a buffer fill their share of chunks, and may begin one more.
        r->bytes += (int64_t)s->count * (r->depth + s->rows) * (int64_t)sizeof *s->buffer;
        r->bytes += INDEX_BYTES;
        s->buffer =
            pm_arena_array(&r->arena, (size_t)s->count * (size_t)r->depth, sizeof *s->buffer);
    }
    return pm_arena_status(&r->arena, "a recording");
}

// --- the file ---

// Writes names and units of the components of z: "s", or "q[0]" in a group of several. Where there
// are too many components for an attribute, writes those of the groups: "q[0:5000]".
static pm_status describe_state(pm_recording *r, const char *path, const pm_layout *layout) {
    const bool whole = layout->nz > MAX_NAMED;
    const size_t capacity = (size_t)(whole ? layout->ngroup : layout->nz);
    const char **name = pm_arena_array(&r->arena, capacity, sizeof *name);
    const char **unit = pm_arena_array(&r->arena, capacity, sizeof *unit);
    PM_TRY(pm_arena_status(&r->arena, "a recording"));
    int count = 0;
    for (int g = 0; g < layout->ngroup; ++g) {
        const pm_group *group = &layout->group[g];
        for (int i = 0; i < (whole ? 1 : group->size); ++i, ++count) {
            name[count] = group->size == 1 ? group->name
                          : whole ? pm_arena_printf(&r->arena, "%s[0:%d]", group->name, group->size)
                                  : pm_arena_printf(&r->arena, "%s[%d]", group->name, i);
            unit[count] = group->unit;
        }
    }
    PM_TRY(pm_arena_status(&r->arena, "a recording"));
    PM_TRY(pm_hdf5_write_texts(r->file, path, "variables", count, name));
    return pm_hdf5_write_texts(r->file, path, "units", count, unit);
}

static pm_status create_all(pm_recording *r) {
    const pm_scene *scene = r->scene;
    PM_TRY(pm_hdf5_write_text(r->file, "/", "format", PM_FILES_RECORDING));
    PM_TRY(pm_hdf5_write_integer(r->file, "/", "version", 2));
    PM_TRY(pm_hdf5_write_integer(r->file, "/", "committed", 0));
    PM_TRY(pm_hdf5_write_text(r->file, "/", "scene", scene->name));
    PM_TRY(pm_hdf5_write_text(r->file, "/", "integrator", scene->physics.integrator->name));
    PM_TRY(pm_hdf5_write_integer(r->file, "/", "substeps", (uint64_t)scene->physics.substeps));
    PM_TRY(pm_hdf5_write_number(r->file, "/", "dt", scene->physics.dt));
    for (int i = 0; i < r->nseries; ++i) {
        recorded_series *s = &r->series[i];
        PM_TRY(pm_hdf5_series_create(&s->in_file, r->file, s->path, s->rank, s->extent, s->rows,
                                     strcmp(s->path, "/step") == 0));
        if (s->unit != NULL) {
            PM_TRY(pm_hdf5_write_text(r->file, s->path, "units", s->unit));
        }
    }
    for (int i = 0; i < r->families.nsubsystem; ++i) {
        const pm_recorded_family *family = &r->families.subsystem[i];
        PM_TRY(describe_state(r, r->series[family->state].path,
                              &scene->physics.subsystem[family->first].layout));
    }
    // The names of the ends; of a range as the scene file has them, "link[i]" and "link[i+1]".
    for (int i = 0; i < r->families.nport; ++i) {
        const pm_recorded_family *family = &r->families.port[i];
        const pm_scene_port *port = &scene->physics.port[family->first];
        const char *folder = pm_arena_printf(&r->arena, "/ports/%s", family->name);
        const char *const ends[2] = {pm_scene_end_name(scene, port, 0),
                                     pm_scene_end_name(scene, port, 1)};
        PM_TRY(pm_arena_status(&r->arena, "a recording"));
        PM_TRY(pm_hdf5_write_texts(r->file, folder, "ends", 2,
                                   family->is_range ? port->between : ends));
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
    for (int i = 0; i < r->nseries; ++i) {
        recorded_series *s = &r->series[i];
        PM_TRY(
            pm_hdf5_series_open(&s->in_file, r->file, s->path, s->rank, s->extent, s->rows, count));
    }
    return PM_OK;
}

static pm_status check_folder(const char *path) {
    const char *slash = strrchr(path, '/');
    char *folder = slash == NULL   ? strdup(".")
                   : slash == path ? strdup("/")
                                   : strndup(path, (size_t)(slash - path));
    PM_TRY(pm_allocated(folder, "a recording"));
    pm_status status = PM_OK;
    if (access(folder, W_OK | X_OK) != 0) {
        status = pm_fail(PM_EFILE, "%s: cannot create a recording: folder %s: %s", path, folder,
                         strerror(errno));
    }
    free(folder);
    return status;
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
    return pm_files_check_output(path, overwrite ? PM_FILES_ANY : PM_FILES_RECORDING);
}

// Opens a new file, or with `count` >= 0 an existing one that holds at least as many samples.
static pm_status open_at(pm_recording **recording, const char *path, const pm_scene *scene,
                         long count) {
    pm_recording *r = calloc(1, sizeof *r);
    PM_TRY(pm_allocated(r, "a recording"));
    pm_status status;
    r->scene = scene;
    r->path = pm_arena_strdup(&r->arena, path);
    PM_TRY_DONE(list_series(r));
    PM_TRY_DONE(count < 0 ? pm_hdf5_create(&r->file, path, PM_HDF5_IN_PLACE)
                          : pm_hdf5_reopen(&r->file, path));
    PM_TRY_DONE(count < 0 ? create_all(r) : open_all(r, count));
    r->flushed = pm_clock();
    *recording = r;
    return PM_OK;
done:
    pm_hdf5_close(r->file);
    PM_DELETE(r);
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
}

// The HDF5 library may crash on a file that its writer did not close. A child process therefore
// opens the file first.
pm_status pm_recording_reopen(pm_recording **recording, const char *path, const pm_scene *scene,
                              long count) {
    const reopening context = {path, scene, count};
    PM_TRY(pm_hdf5_try(path, try_reopen, &context));
    return open_at(recording, path, scene, count);
}

// --- appending ---

// Returns the place of the next series' numbers in its buffer, and goes on to the next series.
static double *next(const recorded_series **at, int row) {
    const recorded_series *s = (*at)++;
    return s->buffer + (size_t)row * (size_t)s->count;
}

// Returns the total of the subsystems with the bits that it has in the ledger.
static double total(int n, const double *value) {
    pm_reproducible_sum sum = {0};
    pm_reproducible_sum_add(&sum, n, value, false);
    return pm_reproducible_sum_value(&sum);
}

// Copies a sample to the next row of all buffers.
static void put_sample(const pm_recording *r, const pm_sample *sample) {
    const pm_scene *scene = r->scene;
    const recorded_series *at = r->series;
    const int row = r->buffered;
    const bool none = sample->step == 0; // no step was before, during which something has flowed
    const pm_flux nothing = {NAN, NAN, NAN, NAN};
    *next(&at, row) = sample->time;
    *next(&at, row) = (double)sample->step;
    *next(&at, row) = sample->outside_energy + total(scene->physics.nsubsystem, sample->energy);
    *next(&at, row) = sample->outside_entropy + total(scene->physics.nsubsystem, sample->entropy);
    *next(&at, row) = sample->energy_residual;
    *next(&at, row) = sample->entropy_residual;
    for (int i = 0; i < r->families.nsubsystem; ++i) {
        const pm_recorded_family *family = &r->families.subsystem[i];
        const size_t state_size = (size_t)at->count * sizeof(double);
        memcpy(next(&at, row), sample->z + scene->physics.subsystem[family->first].first,
               state_size);
        for (size_t k = 0; k < NSUBSYSTEM; ++k) {
            const void *column;
            memcpy(&column, (const char *)sample + of_subsystem[k].column, sizeof column);
            if (of_subsystem[k].name == NULL) {
                continue;
            }
            double *to = next(&at, row);
            const bool whole = of_subsystem[k].whole, empty = none && of_subsystem[k].flows;
            for (int m = 0; m < family->count && (whole || empty); ++m) {
                to[m] = empty ? NAN : (double)((const long *)column)[family->first + m];
            }
            if (!whole && !empty) {
                memcpy(to, (const double *)column + family->first,
                       (size_t)family->count * sizeof *to);
            }
        }
    }
    for (int i = 0; i < r->families.nport; ++i) {
        const pm_recorded_family *family = &r->families.port[i];
        for (size_t k = 0; k < 2 * NEND; ++k) {
            double *to = of_end[k / 2].unit == NULL ? NULL : next(&at, row);
            for (int m = 0; m < family->count && to != NULL; ++m) {
                const pm_flux *flux = &sample->flux[family->first + m][k % 2];
                memcpy(to + m, (const char *)(none ? &nothing : flux) + of_end[k / 2].member,
                       sizeof *to);
            }
        }
    }
    for (int i = 0; i < scene->network.nlive; ++i) {
        *next(&at, row) = none ? NAN : sample->live[i];
    }
}

// Flushes the samples that the file has been handed, and then says that they are certain.
static pm_status commit(pm_recording *r) {
    PM_TRY(pm_hdf5_flush(r->file));
    r->pending = 0;
    return set_committed(r, r->written);
}

static pm_status write_buffers(pm_recording *r) {
    if (r->buffered == 0) {
        return PM_OK;
    }
    if (pm_hdf5_reserve(r->file, r->pending + r->bytes) != PM_OK) {
        // The blocks before this one have their space. After a flush it is known how much they
        // need.
        PM_TRY(commit(r));
        PM_TRY(pm_hdf5_reserve(r->file, r->bytes));
    }
    r->pending += r->bytes;
    for (int i = 0; i < r->nseries; ++i) {
        PM_TRY(pm_hdf5_series_append(&r->series[i].in_file, r->buffered, r->series[i].buffer));
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
    return recording->buffered == recording->depth ? note(recording, write_buffers(recording))
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
    PM_DELETE(recording);
    return status;
}
