// Datasets of trajectories: their memory, their notes, and the HDF5 layout that dataset.h
// describes.
#include "store/dataset.h"

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/digest.h"
#include "base/linalg.h"
#include "store/hdf5_io.h"
#include "store/names.h"

#define LAYOUT "state_layout"
// How far a stored time may lie from t0 + j dt, in units of dt. Files of other tools may round
// times to a few digits.
#define TIME_TOLERANCE 1e-3
#define LONGEST_LAYOUT 60000 // bytes; an HDF5 attribute in an object's header holds 64 KiB

// --- memory ---

// Makes a dataset without names of columns.
static pm_status dataset_alloc(pm_dataset **dataset, int ntrajectory, int ntime, int ncolumn) {
    assert(ntrajectory > 0 && ntime > 0 && ncolumn > 0);
    const size_t nstate = (size_t)ntrajectory * (size_t)ntime;
    pm_dataset *d = NULL;
    PM_TRY(PM_NEW(d, "a dataset"));
    d->ntrajectory = ntrajectory;
    d->ntime = ntime;
    d->ncolumn = ncolumn;
    d->t = pm_arena_array(&d->arena, (size_t)ntime, sizeof *d->t);
    d->z = pm_arena_array(&d->arena, nstate, (size_t)ncolumn * sizeof *d->z);
    PM_RETURN_NEW(dataset, d, "a dataset");
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
    }
    d->column = name;
    PM_RETURN_NEW(dataset, d, "the columns of a dataset");
}

void pm_dataset_free(pm_dataset *dataset) {
    PM_DELETE(dataset);
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
    return pm_arena_status(&dataset->arena, "the rates of a dataset");
}

// --- notes ---

// Keeps a note whose text is already in the arena.
static pm_status note_keep(pm_dataset *d, const char *name, const char *text) {
    pm_note *note = pm_arena_array(&d->arena, (size_t)d->nnote + 1, sizeof *note);
    int i = 0;
    while (i < d->nnote && strcmp(d->note[i].name, name) != 0) {
        ++i;
    }
    const char *key = i < d->nnote ? d->note[i].name : pm_arena_strdup(&d->arena, name);
    PM_TRY(pm_arena_status(&d->arena, "the notes of a dataset"));
    if (d->nnote > 0) {
        memcpy(note, d->note, (size_t)d->nnote * sizeof *note);
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
        return pm_fail(PM_ENOMEM, "out of memory for the notes of a dataset");
    }
    const char *copy = pm_arena_strdup(&dataset->arena, text);
    free(text);
    return note_keep(dataset, name, copy);
}

const char *pm_dataset_find_note(const pm_dataset *dataset, const char *name) {
    for (int i = 0; i < dataset->nnote; ++i) {
        if (strcmp(dataset->note[i].name, name) == 0) {
            return dataset->note[i].text;
        }
    }
    return NULL;
}

pm_status pm_dataset_cut(pm_dataset **dataset, const pm_dataset *whole, int count,
                         const pm_piece *piece) {
    const size_t ncolumn = (size_t)whole->ncolumn;
    pm_dataset *made = NULL;
    pm_status status;
    int ntime = 0;
    for (int i = 0; i < count; ++i) {
        const int own = piece[i].end - piece[i].first;
        ntime = own > ntime ? own : ntime;
    }
    PM_TRY(pm_dataset_new(&made, count, ntime, whole->ncolumn, whole->dt, whole->column));
    made->measured = true;
    made->times = pm_arena_array(&made->arena, (size_t)count * (size_t)ntime, sizeof *made->times);
    PM_TRY_DONE(pm_arena_status(&made->arena, "the pieces of a dataset"));
    for (int i = 0; i < count; ++i) {
        const pm_piece *p = &piece[i];
        for (int j = 0; j < ntime; ++j) {
            const bool has = p->first + j < p->end;
            double *z = pm_dataset_state(made, i, j);
            made->times[(size_t)i * (size_t)ntime + (size_t)j] =
                has ? pm_dataset_time(whole, p->trajectory, p->first + j) : (double)NAN;
            for (size_t c = 0; c < ncolumn; ++c) {
                z[c] = has ? pm_dataset_state(whole, p->trajectory, p->first + j)[c] : (double)NAN;
            }
        }
    }
    for (int i = 0; i < whole->nnote; ++i) {
        PM_TRY_DONE(pm_dataset_note(made, whole->note[i].name, "%s", whole->note[i].text));
    }
    *dataset = made;
    made = NULL;
done:
    pm_dataset_free(made);
    return status;
}

pm_status pm_dataset_units(const pm_dataset *dataset, pm_arena *arena, const char ***unit) {
    const char *text = pm_dataset_find_note(dataset, "units");
    *unit = NULL;
    if (text == NULL) {
        return PM_OK;
    }
    char *rest = pm_arena_strdup(arena, text);
    const char **list = pm_arena_array(arena, (size_t)dataset->ncolumn, sizeof *list);
    PM_TRY(pm_arena_status(arena, "units"));
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

static pm_status note_units(pm_dataset *d, const char *const *unit) {
    size_t size = 1;
    for (int k = 0; k < d->ncolumn; ++k) {
        size += strlen(unit[k]) + 1;
    }
    char *text = pm_arena_alloc(&d->arena, size), *end = text;
    for (int k = 0; text != NULL && k < d->ncolumn; ++k) {
        end = stpcpy(stpcpy(end, k == 0 ? "" : ";"), unit[k]);
    }
    PM_TRY(pm_arena_status(&d->arena, "units"));
    return note_keep(d, "units", text);
}

static void scale_column(pm_dataset *d, int column, double factor, double offset) {
    const size_t count = (size_t)d->ntrajectory * (size_t)d->ntime, n = (size_t)d->ncolumn;
    for (size_t i = 0; i < count; ++i) {
        double *z = d->z + i * n + (size_t)column;
        *z = factor * *z + offset;
        if (d->zdot != NULL) {
            d->zdot[i * n + (size_t)column] *= factor;
        }
    }
}

pm_status pm_dataset_change_units(pm_dataset *dataset, const pm_unit_change *change,
                                  const char *const *to) {
    assert(dataset->change == NULL);
    for (int k = 0; k < dataset->ncolumn; ++k) {
        if (change[k].from != NULL) {
            scale_column(dataset, k, change[k].factor, change[k].offset);
        }
    }
    dataset->change = change;
    return note_units(dataset, to);
}

double pm_dataset_unchanged(const pm_dataset *dataset, int column, double value) {
    const pm_unit_change *change = dataset->change == NULL ? NULL : &dataset->change[column];
    return change == NULL || change->from == NULL ? value
                                                  : (value - change->offset) / change->factor;
}

pm_status pm_dataset_restore_units(pm_dataset *dataset, const pm_dataset *given) {
    const char **unit;
    assert(dataset->ncolumn == given->ncolumn);
    PM_TRY(pm_dataset_units(given, &dataset->arena, &unit));
    for (int k = 0; k < given->ncolumn && given->change != NULL && unit != NULL; ++k) {
        const pm_unit_change *change = &given->change[k];
        if (change->from != NULL) {
            scale_column(dataset, k, 1 / change->factor, -change->offset / change->factor);
            unit[k] = change->from;
        }
    }
    return unit == NULL ? PM_OK : note_units(dataset, unit);
}

// --- checks ---

pm_status pm_times_check(const char *path, int ntime, const double *t, double dt) {
    if (!isfinite(dt) || dt <= 0) {
        return pm_fail(PM_EDATA, "%s: dt is %g, expected a number > 0", path, dt);
    }
    for (int j = 0; j < ntime; ++j) {
        const double expected = t[0] + j * dt;
        if (!(fabs(t[j] - expected) <= TIME_TOLERANCE * dt)) {
            return pm_fail(PM_EDATA, "%s: t[%d] is %.9g, expected t[0] + %d dt = %.9g", path, j,
                           t[j], j, expected);
        }
    }
    return PM_OK;
}

int pm_dataset_length(const pm_dataset *d, int i) {
    int length = d->ntime;
    for (bool over = true; over && length > 1;) {
        const double *row = pm_dataset_state(d, i, length - 1);
        over = true;
        for (int k = 0; k < d->ncolumn && over; ++k) {
            over = isnan(row[k]);
        }
        over = over || isnan(pm_dataset_time(d, i, length - 1));
        length -= over;
    }
    return length;
}

static pm_status check_values(const pm_dataset *d, const char *name, const double *value,
                              const char *path) {
    for (int i = 0; i < d->ntrajectory; ++i) {
        const int length = pm_dataset_length(d, i);
        for (int j = 0; j < d->ntime; ++j) {
            for (int k = 0; k < d->ncolumn; ++k, ++value) {
                const bool missing = d->measured || j >= length;
                if (!isfinite(*value) && !(missing && isnan(*value))) {
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

static pm_status check(const pm_dataset *d, const char *path) {
    PM_TRY(d->times == NULL ? pm_times_check(path, d->ntime, d->t, d->dt) : PM_OK);
    // Measured times rise. NaN follows the last time of a trajectory, which has at least two.
    for (int i = 0; i < d->ntrajectory && d->times != NULL; ++i) {
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
    pm_arena arena = {0};
    pm_names names = {0};
    const pm_status status = pm_names_sort(&names, d->column, d->ncolumn, &arena);
    const int twice = pm_names_twice(&names);
    pm_arena_free(&arena);
    PM_TRY(status);
    if (twice >= 0) {
        return pm_fail(PM_EDATA, "%s: " LAYOUT " names column \"%s\" twice", path,
                       d->column[twice]);
    }
    PM_TRY(check_values(d, "z", d->z, path));
    return d->zdot == NULL ? PM_OK : check_values(d, "zdot", d->zdot, path);
}

// --- loading ---

// Splits the text of state_layout into the names of the columns.
static pm_status split_columns(pm_dataset *d, const char *text, const char *path) {
    char *rest = pm_arena_strdup(&d->arena, text);
    const char **name = pm_arena_array(&d->arena, (size_t)d->ncolumn, sizeof *name);
    PM_TRY(pm_arena_status(&d->arena, "the columns of a dataset"));
    long count = 0; // of all names, although there is room for the columns only
    char *state = NULL;
    for (char *word = strtok_r(rest, " \t\n", &state); word != NULL;
         word = strtok_r(NULL, " \t\n", &state)) {
        pm_name_range range;
        if (pm_name_range_parse(&range, word) != PM_OK) {
            return pm_fail(PM_EDATA, "%s: " LAYOUT ": %s", path, pm_error());
        }
        for (int i = 0; i < range.count && count + i < d->ncolumn; ++i) {
            name[count + i] = pm_name_range_text(&range, i, &d->arena);
        }
        count += range.count;
    }
    PM_TRY(pm_arena_status(&d->arena, "the columns of a dataset"));
    if (count != d->ncolumn) {
        return pm_fail(PM_EDATA, "%s: " LAYOUT " names %ld columns, z has %d", path, count,
                       d->ncolumn);
    }
    d->column = name;
    return PM_OK;
}

// Reads /t [time] or [trajectory][time], and dt if the file has it. Evenly spaced times of all
// trajectories go to d->t.
static pm_status read_measured_times(pm_dataset *d, const pm_hdf5 *file, const char *path) {
    const int shape[2] = {d->ntrajectory, d->ntime};
    const size_t ntime = (size_t)d->ntime;
    int length, count = 0;
    const bool common = pm_hdf5_shape(file, "/t", 1, &length) == PM_OK;
    d->times = pm_arena_array(&d->arena, (size_t)d->ntrajectory * ntime, sizeof *d->times);
    double *distance = pm_arena_array(&d->arena, ntime, sizeof *distance);
    PM_TRY(pm_arena_status(&d->arena, "the times of a dataset"));
    PM_TRY(pm_hdf5_read(file, "/t", common ? 1 : 2, common ? &shape[1] : shape, d->times));
    for (int i = 1; i < d->ntrajectory && common; ++i) {
        memcpy(d->times + (size_t)i * ntime, d->times, ntime * sizeof *d->t);
    }
    if (pm_hdf5_has(file, "/dt")) {
        PM_TRY(pm_hdf5_read(file, "/dt", 0, NULL, &d->dt));
    } else { // the median distance of the times of the first trajectory
        for (int j = 0; j + 1 < d->ntime && !isnan(pm_dataset_time(d, 0, j + 1)); ++j) {
            distance[count++] = pm_dataset_time(d, 0, j + 1) - pm_dataset_time(d, 0, j);
        }
        pm_sort((size_t)count, distance);
        d->dt = count == 0 ? 1 : distance[count / 2];
    }
    memcpy(d->t, d->times, ntime * sizeof *d->t);
    if (common && pm_times_check(path, d->ntime, d->t, d->dt) == PM_OK) {
        d->times = NULL;
    }
    return PM_OK;
}

// Reads /t [trajectory][time] of states, which must be dt apart in each trajectory up to its end.
// The times of the longest trajectory go to d->t.
static pm_status read_times_of_each(pm_dataset *d, const pm_hdf5 *file, const char *path) {
    const int shape[2] = {d->ntrajectory, d->ntime};
    int longest = 0;
    double *times =
        pm_arena_array(&d->arena, (size_t)d->ntrajectory * (size_t)d->ntime, sizeof *times);
    PM_TRY(pm_arena_status(&d->arena, "the times of a dataset"));
    PM_TRY(pm_hdf5_read(file, "/t", 2, shape, times));
    for (int i = 0; i < d->ntrajectory; ++i) {
        const double *own = times + (ptrdiff_t)i * d->ntime;
        int length = 0;
        while (length < d->ntime && !isnan(own[length])) {
            ++length;
        }
        if (pm_times_check(path, length, own, d->dt) != PM_OK) {
            return pm_fail(PM_EDATA,
                           "%s: the times of trajectory %d are not %g s apart, which only those of "
                           "measurements may be: fit them with `noise` in the training file, "
                           "evaluate them with --estimate, and run from them with `estimate` in "
                           "the scene's `reference`",
                           path, i, d->dt);
        }
        if (length > longest) {
            longest = length;
            memcpy(d->t, own, (size_t)length * sizeof *own);
        }
    }
    for (int j = longest; j < d->ntime; ++j) {
        d->t[j] = d->t[0] + j * d->dt;
    }
    return PM_OK;
}

// A file to load; `name` is its dataset of measurements, or NULL for pm_dataset_load.
typedef struct loading {
    const char *path, *name;
} loading;

static pm_status read_content(pm_dataset *d, const pm_hdf5 *file, const loading *l) {
    const int shape[3] = {d->ntrajectory, d->ntime, d->ncolumn};
    const char *layout, **name;
    int times[2], count;
    d->measured = l->name != NULL;
    PM_TRY(pm_hdf5_read_text(file, "/", LAYOUT, &d->arena, &layout));
    PM_TRY(split_columns(d, layout, l->path));
    if (d->measured) {
        PM_TRY(read_measured_times(d, file, l->path));
        PM_TRY(pm_hdf5_read(file, l->name, 3, shape, d->z));
    } else {
        PM_TRY(pm_hdf5_read(file, "/dt", 0, NULL, &d->dt));
        if (pm_hdf5_shape(file, "/t", 2, times) == PM_OK) {
            PM_TRY(read_times_of_each(d, file, l->path));
        } else {
            PM_TRY(pm_hdf5_read(file, "/t", 1, &shape[1], d->t));
        }
        PM_TRY(pm_hdf5_read(file, "/z", 3, shape, d->z));
        if (pm_hdf5_has(file, "/zdot")) {
            PM_TRY(pm_dataset_with_rates(d));
            PM_TRY(pm_hdf5_read(file, "/zdot", 3, shape, d->zdot));
        }
    }
    PM_TRY(pm_hdf5_attributes(file, "/", &d->arena, &count, &name));
    for (int i = 0; i < count; ++i) {
        if (strcmp(name[i], LAYOUT) != 0 && pm_hdf5_is_text(file, "/", name[i])) {
            const char *text;
            PM_TRY(pm_hdf5_read_text(file, "/", name[i], &d->arena, &text));
            PM_TRY(note_keep(d, name[i], text));
        }
    }
    return check(d, l->path);
}

static pm_status load(pm_dataset **dataset, const loading *l) {
    pm_hdf5 *file = NULL;
    pm_dataset *d = NULL;
    int shape[3];
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&file, l->path, PM_HDF5_ANY, PM_EDATA));
    PM_TRY_DONE(pm_hdf5_shape(file, l->name == NULL ? "/z" : l->name, 3, shape));
    PM_TRY_DONE(dataset_alloc(&d, shape[0], shape[1], shape[2]));
    PM_TRY_DONE(read_content(d, file, l));
    *dataset = d;
    d = NULL;
done:
    pm_dataset_free(d);
    pm_hdf5_close(file);
    return status;
}

static void try_load(const void *what) {
    pm_dataset *dataset = NULL;
    (void)load(&dataset, what);
    pm_dataset_free(dataset);
}

pm_status pm_dataset_load(pm_dataset **dataset, const char *path) {
    const loading what = {path, NULL};
    PM_TRY(pm_hdf5_try(path, try_load, &what));
    return load(dataset, &what);
}

pm_status pm_dataset_load_measured(pm_dataset **dataset, const char *path, const char *name) {
    char full[256];
    snprintf(full, sizeof full, "/%s", name);
    const loading what = {path, full};
    PM_TRY(pm_hdf5_try(path, try_load, &what));
    return load(dataset, &what);
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

pm_status pm_dataset_save(const pm_dataset *dataset, const char *path) {
    const pm_dataset *d = dataset;
    const int shape[3] = {d->ntrajectory, d->ntime, d->ncolumn};
    PM_TRY(check(d, path));
    pm_hdf5 *file = NULL;
    pm_status status;
    pm_arena arena = {0};
    const char *layout = join_columns(d, &arena);
    PM_TRY_DONE(pm_arena_status(&arena, "the columns of a dataset"));
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/", LAYOUT, layout));
    for (int i = 0; i < d->nnote; ++i) {
        PM_TRY_DONE(pm_hdf5_write_text(file, "/", d->note[i].name, d->note[i].text));
    }
    PM_TRY_DONE(pm_hdf5_write(file, "/dt", 0, NULL, &d->dt));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/dt", "units", "s"));
    PM_TRY_DONE(d->times != NULL ? pm_hdf5_write(file, "/t", 2, shape, d->times)
                                 : pm_hdf5_write(file, "/t", 1, &shape[1], d->t));
    PM_TRY_DONE(pm_hdf5_write_text(file, "/t", "units", "s"));
    PM_TRY_DONE(pm_hdf5_write(file, "/z", 3, shape, d->z));
    PM_TRY_DONE(d->zdot != NULL ? pm_hdf5_write(file, "/zdot", 3, shape, d->zdot) : PM_OK);
    PM_TRY_DONE(pm_hdf5_write_text(file, "/z", "description", "[trajectory][time][column]"));
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
