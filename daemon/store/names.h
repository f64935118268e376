// Names of dataset columns: many of them found among many, and ranges, "f[0:180]" for f0, f1, ...
// f179.
#ifndef PM_STORE_NAMES_H
#define PM_STORE_NAMES_H

#include "base/arena.h"
#include "base/status.h"

// --- lookups ---

typedef struct pm_name {
    const char *text;
    int position;
} pm_name;

// Sorted once, so that a lookup costs the logarithm of their number.
typedef struct pm_names {
    int count;
    pm_name *sorted; // by text, equal ones by position
} pm_names;

// Of text [count], which must stay; the order lives in the arena. PM_ENOMEM.
pm_status pm_names_sort(pm_names *names, const char *const *text, int count, pm_arena *arena);
// The position of a name, or -1.
int pm_names_find(const pm_names *names, const char *text);
// The position of the later of two equal names, or -1.
int pm_names_twice(const pm_names *names);

// --- ranges ---

// What an item of a list stands for: `count` names, each the prefix and a number from `first` on;
// or itself alone.
typedef struct pm_name_range {
    const char *text;
    int prefix; // characters; -1: the text is a name itself
    int first, count;
} pm_name_range;

// A text of the form PREFIX[A:B] is a range, B left out; `text` must stay. PM_ECONFIG if A and B
// are not whole numbers with A < B <= 10^9, or the prefix has not 1 to 64 characters.
pm_status pm_name_range_parse(pm_name_range *range, const char *text);
// Its name number i, in the arena if it had to be made. NULL: out of memory.
const char *pm_name_range_text(const pm_name_range *range, int i, pm_arena *arena);

// The names separated by blanks, three or more with numbers that follow each other as a range.
// NULL: out of memory.
const char *pm_names_fold(const char *const *text, int count, pm_arena *arena);

#endif
