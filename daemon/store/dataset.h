// Datasets of trajectories in HDF5:
//   /z     [trajectory][time][column]  states, in the columns' units
//   /zdot  [trajectory][time][column]  optional: rates in units of z per s, for training on rates;
//                                      without them, rates are differences of states
//   /t     [time]                      s
//   /dt    scalar                      s
//   state_layout, attribute of /       names of the columns, separated by blanks; "f[0:180]" means
//                                      f0 to f179 (names.h), and is used for more than 60 kB of
//                                      names
//   units, attribute of /              optional: units of the columns, separated by ';'. An empty
//                                      text is a unit that is not known. Readers convert a column
//                                      to the unit of the group that a scene maps it to
//                                      (scene/columns.h)
// A trajectory may be shorter than the others: its last rows of /z are NaN then, and so may be its
// times, in a /t [trajectory][time]. A file of measurements (pm_dataset_load_measured) may have
// uneven times, and NaN where a sample is missing. Other text attributes of / are notes, such as
// title, source, command, seed, or coordinates (scene/weights.h).
#ifndef PM_STORE_DATASET_H
#define PM_STORE_DATASET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/arena.h"
#include "base/status.h"

typedef struct pm_note {
    const char *name, *text;
} pm_note;

// How a column was converted: z = factor x + offset, where x has the unit `from`.
typedef struct pm_unit_change {
    double factor, offset;
    const char *from; // NULL: the column was not converted
} pm_unit_change;

typedef struct pm_dataset {
    pm_arena arena; // owns all that follows
    int ntrajectory, ntime, ncolumn;
    double dt;                 // s
    double *t;                 // [ntime] s
    double *z;                 // [ntrajectory][ntime][ncolumn]; NaN after a trajectory's end
    double *zdot;              // [ntrajectory][ntime][ncolumn]; NULL: there are no rates
    const char *const *column; // [ncolumn] names
    bool measured;             // z may be NaN, which means that there is no such sample
    // [ntrajectory][ntime] s, of a measured dataset whose times are not dt apart or differ between
    // trajectories; NaN after the last sample of a shorter trajectory. NULL: all have the times t.
    double *times;
    const pm_unit_change *change; // [ncolumn]; NULL: no column was converted
    int nnote;
    const pm_note *note; // [nnote]
} pm_dataset;

// Loads and checks a dataset. PM_EFILE: missing, truncated, or not HDF5; PM_EDATA: wrong shapes or
// columns, times that are not dt apart, or a value that is not finite before the end of its
// trajectory, whose trajectory, time and column the error names; PM_ENOMEM. The caller frees.
pm_status pm_dataset_load(pm_dataset **dataset, const char *path);
// Loads measurements from the dataset `name` of the file, such as "z" or "z_noise". In contrast to
// pm_dataset_load, z may be NaN, /t may be [time] or [trajectory][time] and need not be evenly
// spaced, and /dt may be missing, in which case dt is the median distance of two times. There are
// no rates. Fails like pm_dataset_load.
pm_status pm_dataset_load_measured(pm_dataset **dataset, const char *path, const char *name);
// Returns the time in s of sample j of trajectory i, or NaN after the trajectory's end.
static inline double pm_dataset_time(const pm_dataset *d, int i, int j) {
    return d->times == NULL ? d->t[j] : d->times[(size_t)i * (size_t)d->ntime + (size_t)j];
}
// Returns the number of samples of trajectory i: the rows after them have no time, or nothing but
// NaN.
int pm_dataset_length(const pm_dataset *dataset, int i);
// Makes a dataset to be filled: z is zero and t = i dt [s]; column [ncolumn] is copied. PM_ENOMEM.
// The caller frees.
pm_status pm_dataset_new(pm_dataset **dataset, int ntrajectory, int ntime, int ncolumn, double dt,
                         const char *const *column);
// Checks that dt > 0 and that the times t [ntime], s, are t[0] + j dt, which all users of
// trajectories rely on. PM_EDATA; the error begins with `path`.
pm_status pm_times_check(const char *path, int ntime, const double *t, double dt);
// Adds a note, or replaces the note of the same name. PM_ENOMEM.
pm_status pm_dataset_note(pm_dataset *dataset, const char *name, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
// Returns the text of a note, or NULL if there is none of this name.
const char *pm_dataset_find_note(const pm_dataset *dataset, const char *name);
// Divides the note `units` into *unit [ncolumn], whose texts lie in the arena. *unit is NULL if
// there is no such note. An empty text is a unit that is not known. PM_EDATA: the note has another
// number of units; PM_ENOMEM.
pm_status pm_dataset_units(const pm_dataset *dataset, pm_arena *arena, const char ***unit);
// Converts the columns k with change[k].from != NULL [ncolumn], once for a dataset: z becomes
// factor z + offset, and zdot factor zdot. to [ncolumn] are the units of all columns after that,
// for the note `units`. Both arrays must live as long as the dataset. PM_ENOMEM.
pm_status pm_dataset_change_units(pm_dataset *dataset, const pm_unit_change *change,
                                  const char *const *to);
// Returns a number of the column `column` in the unit that it had before pm_dataset_change_units.
double pm_dataset_unchanged(const pm_dataset *dataset, int column, double value);
// Converts all columns of `dataset`, which has the columns of `given`, back to the units that
// `given` had before its columns were converted, and copies its units. PM_EDATA; PM_ENOMEM.
pm_status pm_dataset_restore_units(pm_dataset *dataset, const pm_dataset *given);
// Adds rates to be filled; they are zero. PM_ENOMEM.
pm_status pm_dataset_with_rates(pm_dataset *dataset);
// Checks the dataset and writes it; the file appears whole or not at all. PM_EFILE, PM_EDATA,
// PM_ENOMEM.
pm_status pm_dataset_save(const pm_dataset *dataset, const char *path);
void pm_dataset_free(pm_dataset *dataset); // NULL is allowed

// Leaves out all states of each trajectory after the first `ntime` ones, which is at least 1 and at
// most the number of states.
void pm_dataset_shorten(pm_dataset *dataset, int ntime);
// The samples of a trajectory from `first` up to, but not including, `end`.
typedef struct pm_piece {
    int trajectory, first, end;
} pm_piece;

// Makes a dataset of measurements, whose trajectories are pieces [count] of those of `whole`, with
// their times and without rates. It has the notes of `whole`. PM_ENOMEM. The caller frees.
pm_status pm_dataset_cut(pm_dataset **dataset, const pm_dataset *whole, int count,
                         const pm_piece *piece);

// Returns the state [ncolumn] of trajectory i at time j.
static inline double *pm_dataset_state(const pm_dataset *d, int i, int j) {
    return d->z + ((size_t)i * (size_t)d->ntime + (size_t)j) * (size_t)d->ncolumn;
}

// Returns a digest of the states of one trajectory. An equal trajectory has the same digest in any
// file.
uint64_t pm_dataset_digest(const pm_dataset *dataset, int trajectory);

// Returns the rate [ncolumn] of trajectory i at time j, where the dataset has rates.
static inline double *pm_dataset_rate(const pm_dataset *d, int i, int j) {
    return d->zdot + ((size_t)i * (size_t)d->ntime + (size_t)j) * (size_t)d->ncolumn;
}

#endif
