// A record holds the numbers that a module needs to go on from a checkpoint. The module lists these
// numbers, each with a name, in one function. Depending on the record that it is given, this
// function counts, saves or restores the numbers. One list serves all three purposes, so that they
// can never disagree.
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

// Returns true if the record restores. A number then has its restored value as soon as it was put
// into the record.
static inline bool pm_record_restores(const pm_record *record) {
    return record->from != NULL;
}

// Puts value [count] into the record under a name: the record counts, saves or restores it. If
// `value` is NULL, the record saves zeros and restores nothing. Cannot fail and allocates nothing.
void pm_record_put(pm_record *record, const char *name, double *value, int count);
// Put one number into the record in the same way. A whole number is exact up to 2^53 in magnitude.
void pm_record_put_long(pm_record *record, const char *name, long *value);
void pm_record_put_int(pm_record *record, const char *name, int *value);

#endif
