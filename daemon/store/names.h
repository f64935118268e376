// Names of dataset columns: a quick search among many names, and ranges such as "f[0:180]" for f0,
// f1, ... f179.
#ifndef PM_STORE_NAMES_H
#define PM_STORE_NAMES_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"

// --- lookups ---

typedef struct pm_name {
    const char *text;
    int position; // in the list of names before sorting
} pm_name;

// Names in sorted order, so that a lookup takes a time that grows with the logarithm of their
// number.
typedef struct pm_names {
    int count;
    pm_name *sorted; // [count] ordered by text; equal texts are ordered by position
} pm_names;

// Sorts text [count]. The texts must outlive the result; the order lives in the arena. PM_ENOMEM.
pm_status pm_names_sort(pm_names *names, const char *const *text, int count, pm_arena *arena);
// Returns the position of a name, or -1.
int pm_names_find(const pm_names *names, const char *text);
// Returns the position of the second of two equal names, or -1 if all names differ.
int pm_names_twice(const pm_names *names);

// --- ranges ---

// The names that one word of a list means: `count` names, each the prefix followed by a number from
// `first` on, or the word itself.
typedef struct pm_name_range {
    const char *text;
    int prefix; // length of the prefix in characters; -1: the word itself is the only name
    int first, count;
} pm_name_range;

// Reads "[A:B]" and moves `text` past it. Returns false if `text` begins with something else, or
// if A < B <= most does not hold.
bool pm_name_axis_read(const char **text, long most, int *first, int *count);

// Parses a word. A word of the form PREFIX[A:B] means the numbers from A up to, not including, B.
// `text` must outlive the range. PM_ECONFIG: A and B are not whole numbers with A < B <= 10^9, or
// the prefix does not have 1 to 64 characters.
pm_status pm_name_range_parse(pm_name_range *range, const char *text);
// Returns name i of the range, made in the arena if need be. NULL: out of memory.
const char *pm_name_range_text(const pm_name_range *range, int i, pm_arena *arena);

// Joins text [count] by blanks. Three or more names with the same prefix and consecutive numbers
// become a range. The result lives in the arena. NULL: out of memory.
const char *pm_names_fold(const char *const *text, int count, pm_arena *arena);

#endif
