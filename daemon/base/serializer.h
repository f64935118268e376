// A serializer holds the numbers that a module needs to go on from a checkpoint. The module lists
// these numbers, each with a name, in one function. Depending on the serializer that it is given,
// this function counts, saves or restores the numbers. One list serves all three purposes, so that
// they can never disagree.
//
//     void link_record(link *l, pm_serializer *serializer) {
//         pm_serializer_put_long(serializer, "step", &l->step);
//         pm_serializer_put(serializer, "z", l->z, l->nz);
//     }
#ifndef PM_BASE_SERIALIZER_H
#define PM_BASE_SERIALIZER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct pm_serializer {
    double *to; // where the next number is saved; NULL: the serializer does not save
    const double
        *from; // where the next number is restored from; NULL: the serializer does not restore
    int count; // numbers put so far
    uint64_t layout; // a digest of the names and counts put so far
} pm_serializer;

// Returns a serializer that only counts. `kind` names what the numbers describe, such as "node".
pm_serializer pm_serializer_count(const char *kind);
// Return a serializer that saves into number [count], and one that restores from it. The caller
// owns `number`, whose size it knows from a serializer that counts.
pm_serializer pm_serializer_save(const char *kind, double *number);
pm_serializer pm_serializer_restore(const char *kind, const double *number);

// Returns true if the serializer restores. A number then has its restored value as soon as it was
// put into the serializer.
static inline bool pm_serializer_restores(const pm_serializer *serializer) {
    return serializer->from != NULL;
}

// Puts value [count] into the serializer under a name: the serializer counts, saves or restores it.
// If `value` is NULL, the serializer saves zeros and restores nothing. Cannot fail and allocates
// nothing.
void pm_serializer_put(pm_serializer *serializer, const char *name, double *value, int count);
// Put one number into the serializer in the same way. A whole number is exact up to 2^53 in
// magnitude.
void pm_serializer_put_long(pm_serializer *serializer, const char *name, long *value);
void pm_serializer_put_int(pm_serializer *serializer, const char *name, int *value);

#endif
