// Datasets of trajectories: their memory, their notes, and the HDF5 layout that dataset.h
// describes.
#include "store/dataset.h"

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/attempt.h"
#include "base/digest.h"
#include "store/hdf5_io.h"
#include "store/names.h"
#include "store/times.h"

#define LAYOUT "state_layout"
#define LONGEST_LAYOUT 60000 // bytes; an HDF5 attribute in an object's header holds 64 KiB

// --- memory ---

static pm_status fail_memory(void) {
    return pm_fail(PM_ENOMEM, "dataset: out of memory");
}

// Makes a dataset without names of columns.
static pm_status dataset_alloc(pm_dataset **dataset, int ntrajectory, int ntime, int ncolumn) {
    assert(ntrajectory > 0 && ntime > 0 && ncolumn > 0);
    const size_t nstate = (size_t)ntrajectory * (size_t)ntime;
    pm_dataset *d = calloc(1, sizeof *d);
    if (d == NULL) {
        return fail_memory();
    }
    d->ntrajectory = ntrajectory;
    d->ntime = ntime;
    d->ncolumn = ncolumn;
    d->t = pm_arena_array(&d->arena, (size_t)ntime, sizeof *d->t);
    d->z = pm_arena_array(&d->arena, nstate, (size_t)ncolumn * sizeof *d->z);
    if (d->t == NULL || d->z == NULL) {
        pm_dataset_free(d);
        return fail_memory();
    }
    *dataset = d;
    return PM_OK;
}

pm_status pm_dataset_new(pm_dataset **dataset, int ntrajectory, int ntime, int ncolumn, double dt,
                         const char *const *column) {
    pm_dataset *d;
    PM_TRY(dataset_alloc(&d, ntrajectory, ntime, ncolumn));
    d->dt = dt;
    for (int j = 0; j < ntime; ++j) {
        d->t[j] = j * dt;
    }
    const char **name = pm_arena_array(&d->arena, (size_t)ncolumn, sizeof *name);
    for (int i = 0; name != NULL && i < ncolumn; ++i) {
        name[i] = pm_arena_strdup(&d->arena, column[i]);
        name = name[i] == NULL ? NULL : name;
    }
    if (name == NULL) {
        pm_dataset_free(d);
        return fail_memory();
    }
    d->column = name;
    *dataset = d;
    return PM_OK;
}

void pm_dataset_free(pm_dataset *dataset) {
    if (dataset != NULL) {
        pm_arena_free(&dataset->arena);
        free(dataset);
    }
}

// Moves the first `ntime` rows of each trajectory in x [trajectories][times][columns] to the front.
static void shorten(const pm_dataset *d, double *x, int ntime) {
    const size_t kept = (size_t)ntime * (size_t)d->ncolumn;
    const size_t length = (size_t)d->ntime * (size_t)d->ncolumn;
    for (size_t i = 1; x != NULL && i < (size_t)d->ntrajectory; ++i) {
        memmove(x + i * kept, x + i * length, kept * sizeof *x);
    }
}

void pm_dataset_shorten(pm_dataset *dataset, int ntime) {
    shorten(dataset, dataset->z, ntime);
    shorten(dataset, dataset->zdot, ntime);
    for (size_t i = 1; dataset->times != NULL && i < (size_t)dataset->ntrajectory; ++i) {
        memmove(dataset->times + i * (size_t)ntime, dataset->times + i * (size_t)dataset->ntime,
                (size_t)ntime * sizeof *dataset->times);
    }
    dataset->ntime = ntime;
}

pm_status pm_dataset_with_rates(pm_dataset *dataset) {
    const size_t count = (size_t)dataset->ntrajectory * (size_t)dataset->ntime;
    dataset->zdot =
        pm_arena_array(&dataset->arena, count * (size_t)dataset->ncolumn, sizeof *dataset->zdot);
    return dataset->zdot == NULL ? fail_memory() : PM_OK;
}

// --- notes ---

// Keeps a note whose text is already in the arena.
static pm_status note_keep(pm_dataset *d, const char *name, const char *text) {
    pm_note *note = pm_arena_array(&d->arena, (size_t)d->nnote + 1, sizeof *note);
    if (note == NULL) {
        return fail_memory();
    }
    int i = 0;
    while (i < d->nnote && strcmp(d->note[i].name, name) != 0) {
        ++i;
    }
    if (d->nnote > 0) {
        memcpy(note, d->note, (size_t)d->nnote * sizeof *note);
    }
    const char *key = i < d->nnote ? note[i].name : pm_arena_strdup(&d->arena, name);
    if (key == NULL) {
        return fail_memory();
    }
    note[i] = (pm_note){.name = key, .text = text};
    d->nnote += i == d->nnote;
    d->note = note;
    return PM_OK;
}

pm_status pm_dataset_note(pm_dataset *dataset, const char *name, const char *format, ...) {
    assert(strcmp(name, LAYOUT) != 0);
    char *text = NULL;
    va_list arguments;
    va_start(arguments, format);
    const int length = vasprintf(&text, format, arguments);
    va_end(arguments);
    if (length < 0) {
        return fail_memory();
    }
    const char *copy = pm_arena_strdup(&dataset->arena, text);
    free(text);
    return copy == NULL ? fail_memory() : note_keep(dataset, name, copy);
}

const char *pm_dataset_find_note(const pm_dataset *dataset, const char *name) {
    for (int i = 0; i < dataset->nnote; ++i) {
        if (strcmp(dataset->note[i].name, name) == 0) {
            return dataset->note[i].text;
        }
    }
    return NULL;
}

pm_status pm_dataset_units(const pm_dataset *dataset, pm_arena *arena, const char ***unit) {
    const char *text = pm_dataset_find_note(dataset, "units");
    *unit = NULL;
    if (text == NULL) {
        return PM_OK;
    }
    char *rest = pm_arena_strdup(arena, text);
    const char **list = pm_arena_array(arena, (size_t)dataset->ncolumn, sizeof *list);
    if (rest == NULL || list == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for units");
    }
    int count = 0;
    for (char *word = strsep(&rest, ";"); word != NULL; word = strsep(&rest, ";"), ++count) {
        if (count < dataset->ncolumn) {
            list[count] = word;
        }
    }
    *unit = list;
    return count == dataset->ncolumn
               ? PM_OK
               : pm_fail(PM_EDATA, "the dataset names %d units of %d columns: \"%.64s\"", count,
                         dataset->ncolumn, text);
}

// --- checks ---

static pm_status check_columns(const pm_dataset *d, const char *path) {
    pm_arena arena = {0};
    pm_names names = {0};
    const pm_status status = pm_names_sort(&names, d->column, d->ncolumn, &arena);
    const int twice = pm_names_twice(&names);
    pm_arena_free(&arena);
    PM_TRY(status);
    return twice < 0 ? PM_OK
                     : pm_fail(PM_EDATA, "%s: " LAYOUT " names column \"%s\" twice", path,
                               d->column[twice]);
}

static pm_status check_values(const pm_dataset *d, const char *name, const double *value,
                              const char *path) {
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int j = 0; j < d->ntime; ++j) {
            for (int k = 0; k < d->ncolumn; ++k, ++value) {
                if (!isfinite(*value) && !(d->measured && isnan(*value))) {
                    return pm_fail(PM_EDATA,
                                   "%s: %s of trajectory %d, time %d, column \"%s\" is %g, "
                                   "expected a finite number (indices from 0)",
                                   path, name, i, j, d->column[k], *value);
                }
            }
        }
    }
    return PM_OK;
}

// Measured times rise, and may end before the last sample.
static pm_status check_times(const pm_dataset *d, const char *path) {
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int j = 0; j < d->ntime; ++j) {
            const double now = pm_dataset_time(d, i, j);
            const double before = j == 0 ? -INFINITY : pm_dataset_time(d, i, j - 1);
            const bool over = j >= 2 && isnan(now);
            if (!over && !(isfinite(now) && now > before)) {
                return pm_fail(PM_EDATA,
                               "%s: time %d of trajectory %d is %g s after %g s, expected rising "
                               "times, at least two (indices from 0)",
                               path, j, i, now, before);
            }
        }
    }
    return PM_OK;
}

static pm_status check(const pm_dataset *d, const char *path) {
    PM_TRY(d->times != NULL ? check_times(d, path) : pm_times_check(path, d->ntime, d->t, d->dt));
    PM_TRY(check_columns(d, path));
    PM_TRY(check_values(d, "z", d->z, path));
    return d->zdot == NULL ? PM_OK : check_values(d, "zdot", d->zdot, path);
}

// --- loading ---

// Appends the names that one word of state_layout means, as far as there is room; `count` counts
// all.
static pm_status take_word(pm_dataset *d, const char *word, const char **name, long *count,
                           const char *path) {
    pm_name_range range;
    if (pm_name_range_parse(&range, word) != PM_OK) {
        return pm_fail(PM_EDATA, "%s: " LAYOUT ": %s", path, pm_error());
    }
    for (int i = 0; i < range.count && *count + i < d->ncolumn; ++i) {
        name[*count + i] = pm_name_range_text(&range, i, &d->arena);
        if (name[*count + i] == NULL) {
            return fail_memory();
        }
    }
    *count += range.count;
    return PM_OK;
}

// Splits the text of state_layout into the names of the columns.
static pm_status split_columns(pm_dataset *d, const char *text, const char *path) {
    char *rest = pm_arena_strdup(&d->arena, text);
    const char **name = pm_arena_array(&d->arena, (size_t)d->ncolumn, sizeof *name);
    if (rest == NULL || name == NULL) {
        return fail_memory();
    }
    long count = 0;
    char *state = NULL;
    for (char *word = strtok_r(rest, " \t\n", &state); word != NULL;
         word = strtok_r(NULL, " \t\n", &state)) {
        PM_TRY(take_word(d, word, name, &count, path));
    }
    if (count != d->ncolumn) {
        return pm_fail(PM_EDATA, "%s: " LAYOUT " names %ld columns, z has %d", path, count,
                       d->ncolumn);
    }
    d->column = name;
    return PM_OK;
}

static pm_status read_notes(pm_dataset *d, const pm_hdf5 *file) {
    int count;
    const char **name;
    PM_TRY(pm_hdf5_attributes(file, "/", &d->arena, &count, &name));
    for (int i = 0; i < count; ++i) {
        if (strcmp(name[i], LAYOUT) != 0 && pm_hdf5_is_text(file, "/", name[i])) {
            const char *text;
            PM_TRY(pm_hdf5_read_text(file, "/", name[i], &d->arena, &text));
            PM_TRY(note_keep(d, name[i], text));
        }
    }
    return PM_OK;
}

static pm_status read_content(pm_dataset *d, const pm_hdf5 *file, const char *path) {
    const int shape[3] = {d->ntrajectory, d->ntime, d->ncolumn};
    const char *layout;
    PM_TRY(pm_hdf5_read_text(file, "/", LAYOUT, &d->arena, &layout));
    PM_TRY(split_columns(d, layout, path));
    PM_TRY(pm_hdf5_read(file, "/dt", 0, NULL, &d->dt));
    int times[2];
    if (pm_hdf5_shape(file, "/t", 2, times) == PM_OK) {
        return pm_fail(
            PM_EDATA,
            "%s: /t has the times of each trajectory, which only measurements may have: fit "
            "them with `noise` in the training file, and evaluate them with --estimate",
            path);
    }
    PM_TRY(pm_hdf5_read(file, "/t", 1, &shape[1], d->t));
    PM_TRY(pm_hdf5_read(file, "/z", 3, shape, d->z));
    if (pm_hdf5_has(file, "/zdot")) {
        PM_TRY(pm_dataset_with_rates(d));
        PM_TRY(pm_hdf5_read(file, "/zdot", 3, shape, d->zdot));
    }
    PM_TRY(read_notes(d, file));
    return check(d, path);
}

static pm_status load(pm_dataset **dataset, const char *path) {
    pm_hdf5 *file = NULL;
    pm_dataset *d = NULL;
    int shape[3];
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA));
    PM_TRY_DONE(pm_hdf5_shape(file, "/z", 3, shape));
    PM_TRY_DONE(dataset_alloc(&d, shape[0], shape[1], shape[2]));
    PM_TRY_DONE(read_content(d, file, path));
    *dataset = d;
    d = NULL;
done:
    pm_dataset_free(d);
    pm_hdf5_close(file);
    return status;
}

// --- loading measurements ---

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

// The median distance of the times of the first trajectory. PM_ENOMEM.
static pm_status median_distance(const pm_dataset *d, double *dt) {
    double *distance = malloc((size_t)d->ntime * sizeof *distance);
    int count = 0;
    if (distance == NULL) {
        return fail_memory();
    }
    for (int j = 0; j + 1 < d->ntime && !isnan(pm_dataset_time(d, 0, j + 1)); ++j) {
        distance[count++] = pm_dataset_time(d, 0, j + 1) - pm_dataset_time(d, 0, j);
    }
    qsort(distance, (size_t)count, sizeof *distance, compare);
    *dt = count == 0 ? 1 : distance[count / 2];
    free(distance);
    return PM_OK;
}

// Reads /t [time] or [trajectory][time]. Evenly spaced times of all trajectories go to d->t.
static pm_status read_times(pm_dataset *d, const pm_hdf5 *file, const char *path) {
    const int shape[2] = {d->ntrajectory, d->ntime};
    int length;
    const bool common = pm_hdf5_shape(file, "/t", 1, &length) == PM_OK;
    d->times =
        pm_arena_array(&d->arena, (size_t)d->ntrajectory * (size_t)d->ntime, sizeof *d->times);
    if (d->times == NULL) {
        return fail_memory();
    }
    PM_TRY(pm_hdf5_read(file, "/t", common ? 1 : 2, common ? &shape[1] : shape, d->times));
    for (int i = 1; i < d->ntrajectory && common; ++i) {
        memcpy(d->times + (size_t)i * (size_t)d->ntime, d->times, (size_t)d->ntime * sizeof *d->t);
    }
    PM_TRY(pm_hdf5_has(file, "/dt") ? pm_hdf5_read(file, "/dt", 0, NULL, &d->dt)
                                    : median_distance(d, &d->dt));
    memcpy(d->t, d->times, (size_t)d->ntime * sizeof *d->t);
    if (common && pm_times_check(path, d->ntime, d->t, d->dt) == PM_OK) {
        d->times = NULL;
    }
    return PM_OK;
}

static pm_status read_measured(pm_dataset *d, const pm_hdf5 *file, const char *path,
                               const char *name) {
    const int shape[3] = {d->ntrajectory, d->ntime, d->ncolumn};
    const char *layout;
    d->measured = true;
    PM_TRY(pm_hdf5_read_text(file, "/", LAYOUT, &d->arena, &layout));
    PM_TRY(split_columns(d, layout, path));
    PM_TRY(read_times(d, file, path));
    PM_TRY(pm_hdf5_read(file, name, 3, shape, d->z));
    PM_TRY(read_notes(d, file));
    return check(d, path);
}

static pm_status load_measured(pm_dataset **dataset, const char *path, const char *name) {
    pm_hdf5 *file = NULL;
    pm_dataset *d = NULL;
    int shape[3];
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA));
    PM_TRY_DONE(pm_hdf5_shape(file, name, 3, shape));
    PM_TRY_DONE(dataset_alloc(&d, shape[0], shape[1], shape[2]));
    PM_TRY_DONE(read_measured(d, file, path, name));
    *dataset = d;
    d = NULL;
done:
    pm_dataset_free(d);
    pm_hdf5_close(file);
    return status;
}

// The dataset that a child process tries to load; `name` is NULL for pm_dataset_load.
typedef struct attempt {
    const char *path, *name;
} attempt;

static void try_load(const void *context) {
    const attempt *a = context;
    pm_dataset *dataset = NULL;
    (void)(a->name == NULL ? load(&dataset, a->path) : load_measured(&dataset, a->path, a->name));
    pm_dataset_free(dataset);
}

static pm_status try_foreign(const char *path, const char *name) {
    if (pm_hdf5_is_own(path)) {
        return PM_OK;
    }
    char what[512];
    const attempt a = {path, name};
    snprintf(what, sizeof what, "%s: the file is damaged: the HDF5 library crashes on it", path);
    return pm_attempt(try_load, &a, PM_EFILE, what);
}

pm_status pm_dataset_load_measured(pm_dataset **dataset, const char *path, const char *name) {
    char full[256];
    snprintf(full, sizeof full, "/%s", name);
    PM_TRY(try_foreign(path, full));
    return load_measured(dataset, path, full);
}

// A file of another tool may use any feature of HDF5, and damaged files can crash the library. A
// child process therefore opens the file first.
pm_status pm_dataset_load(pm_dataset **dataset, const char *path) {
    PM_TRY(try_foreign(path, NULL));
    return load(dataset, path);
}

// --- saving ---

// Returns the names of the columns, separated by blanks; as ranges if one attribute could not hold
// them all. NULL: out of memory.
static const char *join_columns(const pm_dataset *d, pm_arena *arena) {
    size_t size = 1;
    for (int i = 0; i < d->ncolumn; ++i) {
        size += strlen(d->column[i]) + 1;
    }
    if (size > LONGEST_LAYOUT) {
        return pm_names_fold(d->column, d->ncolumn, arena);
    }
    char *text = pm_arena_alloc(arena, size), *end = text;
    for (int i = 0; text != NULL && i < d->ncolumn; ++i) {
        end = stpcpy(stpcpy(end, i == 0 ? "" : " "), d->column[i]);
    }
    return text;
}

static pm_status write_content(const pm_dataset *d, pm_hdf5 *file, const char *layout) {
    const int shape[3] = {d->ntrajectory, d->ntime, d->ncolumn};
    PM_TRY(pm_hdf5_write_text(file, "/", LAYOUT, layout));
    for (int i = 0; i < d->nnote; ++i) {
        PM_TRY(pm_hdf5_write_text(file, "/", d->note[i].name, d->note[i].text));
    }
    PM_TRY(pm_hdf5_write(file, "/dt", 0, NULL, &d->dt));
    PM_TRY(pm_hdf5_write_text(file, "/dt", "units", "s"));
    PM_TRY(d->times != NULL ? pm_hdf5_write(file, "/t", 2, shape, d->times)
                            : pm_hdf5_write(file, "/t", 1, &shape[1], d->t));
    PM_TRY(pm_hdf5_write_text(file, "/t", "units", "s"));
    PM_TRY(pm_hdf5_write(file, "/z", 3, shape, d->z));
    if (d->zdot != NULL) {
        PM_TRY(pm_hdf5_write(file, "/zdot", 3, shape, d->zdot));
    }
    return pm_hdf5_write_text(file, "/z", "description", "[trajectory][time][column]");
}

pm_status pm_dataset_save(const pm_dataset *dataset, const char *path) {
    PM_TRY(check(dataset, path));
    pm_hdf5 *file = NULL;
    pm_status status;
    pm_arena arena = {0};
    const char *layout = join_columns(dataset, &arena);
    if (layout == NULL) {
        return fail_memory();
    }
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    PM_TRY_DONE(write_content(dataset, file, layout));
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    pm_arena_free(&arena);
    return status;
}

uint64_t pm_dataset_digest(const pm_dataset *dataset, int trajectory) {
    return pm_digest_doubles(PM_DIGEST_INIT, pm_dataset_state(dataset, trajectory, 0),
                             (size_t)dataset->ntime * (size_t)dataset->ncolumn);
}
