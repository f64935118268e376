// Datasets of trajectories, HDF5:
//   /z [trajectory][time][column] double, /t [time] s, /dt scalar s,
//   /zdot (optional), like /z: its rate, for training on rates; otherwise taken by differences,
//   attribute state_layout of /: the columns' names separated by blanks; "f[0:180]" stands for f0
//   to f179 (names.h), and is written so where the names are longer than 60 kB;
//   other text attributes of / are kept as notes (title, source, command, seed ...; `coordinates`
//   as in weights.h);
//   /units attribute of / (optional): the columns' units separated by ';'.
#ifndef PM_STORE_DATASET_H
#define PM_STORE_DATASET_H

#include <stddef.h>

#include "base/arena.h"
#include "base/status.h"

typedef struct pm_note {
    const char *name, *text;
} pm_note;

typedef struct pm_dataset {
    pm_arena arena; // owns all that follows
    int ntrajectory, ntime, ncolumn;
    double dt;                 // s
    double *t;                 // [ntime] s
    double *z;                 // [ntrajectory][ntime][ncolumn]
    double *zdot;              // [ntrajectory][ntime][ncolumn], or NULL
    const char *const *column; // [ncolumn]
    int nnote;
    const pm_note *note;
} pm_dataset;

// PM_EFILE (missing, truncated, not HDF5), PM_EDATA (shapes, columns, a value that is not finite:
// the error names trajectory, time and column), PM_ENOMEM. The caller frees.
pm_status pm_dataset_load(pm_dataset **dataset, const char *path);
// Makes an empty one to be filled: z zeroed, t = i dt, columns copied.
pm_status pm_dataset_new(pm_dataset **dataset, int ntrajectory, int ntime, int ncolumn, double dt,
                         const char *const *column);
// Adds a note; replaces one of the same name.
pm_status pm_dataset_note(pm_dataset *dataset, const char *name, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
// The text of a note, or NULL.
const char *pm_dataset_find_note(const pm_dataset *dataset, const char *name);
// Adds rates to be filled, zeroed. PM_ENOMEM.
pm_status pm_dataset_with_rates(pm_dataset *dataset);
pm_status pm_dataset_save(const pm_dataset *dataset, const char *path);
void pm_dataset_free(pm_dataset *dataset); // NULL is allowed

// The state of trajectory i at time j: [ncolumn].
static inline double *pm_dataset_state(const pm_dataset *d, int i, int j) {
    return d->z + ((size_t)i * (size_t)d->ntime + (size_t)j) * (size_t)d->ncolumn;
}

// Its rate; there must be rates.
static inline double *pm_dataset_rate(const pm_dataset *d, int i, int j) {
    return d->zdot + ((size_t)i * (size_t)d->ntime + (size_t)j) * (size_t)d->ncolumn;
}

#endif
