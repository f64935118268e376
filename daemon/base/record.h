// A record holds the numbers that a module needs to go on from a checkpoint. The module lists them
// in one function, which puts each under a name; that function then counts, saves or restores them,
// so that the three can never disagree.
//
//     void link_record(link *l, pm_record *record) {
//         pm_record_put_long(record, "step", &l->step);
//         pm_record_put(record, "z", l->z, l->nz);
//     }
#ifndef PM_BASE_RECORD_H
#define PM_BASE_RECORD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct pm_record {
    double *to;         // where the next number is saved; NULL: the record does not save
    const double *from; // where the next number is restored from; NULL: the record does not restore
    int count;          // numbers put so far
    uint64_t layout;    // a digest of the names and counts put so far
} pm_record;

// Returns a record that only counts. `kind` names what the numbers describe, such as "node".
pm_record pm_record_count(const char *kind);
// Return a record that saves into number [count], and one that restores from it. The caller owns
// `number`, whose size it knows from a record that counts.
pm_record pm_record_save(const char *kind, double *number);
pm_record pm_record_restore(const char *kind, const double *number);

// Returns true if the record restores. A number then has its restored value after it was put.
static inline bool pm_record_restores(const pm_record *record) {
    return record->from != NULL;
}

// Puts value [count] under a name: counts, saves or restores it. A NULL value counts as zeros and
// is not restored. Cannot fail and allocates nothing.
void pm_record_put(pm_record *record, const char *name, double *value, int count);
// Puts one whole number; exact up to 2^53 in magnitude.
void pm_record_put_long(pm_record *record, const char *name, long *value);
void pm_record_put_int(pm_record *record, const char *name, int *value);
void pm_record_put_bool(pm_record *record, const char *name, bool *value);

#endif
