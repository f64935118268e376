// Sorts names, expands ranges into names and folds names into ranges.
#include "store/names.h"

#include <ctype.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_PREFIX 64
#define MAX_NUMBER 1000000000L
#define SHORTEST_RANGE 3 // names; fewer are as easily read one by one

// --- lookups ---

static int compare(const void *a, const void *b) {
    const pm_name *x = a, *y = b;
    const int order = strcmp(x->text, y->text);
    return order != 0 ? order : x->position - y->position;
}

static int compare_text(const void *text, const void *name) {
    return strcmp(text, ((const pm_name *)name)->text);
}

pm_status pm_names_sort(pm_names *names, const char *const *text, int count, pm_arena *arena) {
    pm_name *sorted = pm_arena_array(arena, (size_t)count, sizeof *sorted);
    PM_TRY(pm_arena_status(arena, "%d names", count));
    for (int i = 0; i < count; ++i) {
        sorted[i] = (pm_name){text[i], i};
    }
    qsort(sorted, (size_t)count, sizeof *sorted, compare);
    *names = (pm_names){count, sorted};
    return PM_OK;
}

int pm_names_find(const pm_names *names, const char *text) {
    const pm_name *found =
        bsearch(text, names->sorted, (size_t)names->count, sizeof *found, compare_text);
    return found == NULL ? -1 : found->position;
}

int pm_names_twice(const pm_names *names) {
    for (int i = 1; i < names->count; ++i) {
        if (strcmp(names->sorted[i - 1].text, names->sorted[i].text) == 0) {
            return names->sorted[i].position;
        }
    }
    return -1;
}

// --- ranges ---

// Reads a whole number and moves `text` past it. Returns -1 if `text` begins with none.
static long read_number(const char **text) {
    char *end;
    if (!isdigit((unsigned char)**text)) {
        return -1;
    }
    const long number = strtol(*text, &end, 10); // saturates, and the range then refuses it
    *text = end;
    return number;
}

bool pm_name_axis_read(const char **text, long most, int *first, int *count) {
    const char *rest = *text + (**text == '[');
    const long low = read_number(&rest);
    const bool colon = *rest == ':';
    rest += colon;
    const long end = read_number(&rest);
    if (**text != '[' || !colon || *rest != ']' || low < 0 || end <= low || end > most) {
        return false;
    }
    *text = rest + 1;
    *first = (int)low;
    *count = (int)(end - low);
    return true;
}

pm_status pm_name_range_parse(pm_name_range *range, const char *text) {
    const char *open = strrchr(text, '['), *rest = open;
    if (open == NULL || strchr(open, ':') == NULL || text[strlen(text) - 1] != ']') {
        *range = (pm_name_range){.text = text, .prefix = -1, .count = 1};
        return PM_OK;
    }
    const ptrdiff_t prefix = open - text;
    pm_name_range read = {.text = text, .prefix = (int)prefix};
    if (!pm_name_axis_read(&rest, MAX_NUMBER, &read.first, &read.count) || *rest != '\0' ||
        prefix < 1 || prefix > MAX_PREFIX) {
        return pm_fail(PM_ECONFIG,
                       "expected a range PREFIX[A:B] with A < B, such as f[0:3] for f0, f1 and f2, "
                       "found \"%.64s\"",
                       text);
    }
    *range = read;
    return PM_OK;
}

const char *pm_name_range_text(const pm_name_range *range, int i, pm_arena *arena) {
    return range->prefix < 0
               ? range->text
               : pm_arena_printf(arena, "%.*s%d", range->prefix, range->text, range->first + i);
}

// --- folding ---

// Splits a name into prefix and number, as a range would join them. Returns the number, or -1 if
// there is none.
static long split(const char *text, size_t *prefix) {
    size_t at = strlen(text);
    while (at > 0 && isdigit((unsigned char)text[at - 1])) {
        --at;
    }
    *prefix = at;
    const char *digits = text + at;
    const bool plain = digits[0] != '\0' && (digits[0] != '0' || digits[1] == '\0');
    const long number = plain ? strtol(digits, NULL, 10) : -1;
    return at > 0 && at <= MAX_PREFIX && number < MAX_NUMBER ? number : -1;
}

const char *pm_names_fold(const char *const *text, int count, pm_arena *arena) {
    size_t size = 1; // a range is never longer than the three names it replaces
    for (int i = 0; i < count; ++i) {
        size += strlen(text[i]) + 1;
    }
    char *folded = pm_arena_alloc(arena, size), *end = folded;
    for (int i = 0; folded != NULL && i < count;) {
        size_t prefix, other;
        const long first = split(text[i], &prefix);
        int n = 1; // names, from this one on, that a single range can replace
        while (first >= 0 && i + n < count && split(text[i + n], &other) == first + n &&
               other == prefix && strncmp(text[i], text[i + n], prefix) == 0) {
            ++n;
        }
        end = i == 0 ? end : stpcpy(end, " ");
        if (n < SHORTEST_RANGE) {
            end = stpcpy(end, text[i++]);
        } else {
            end += snprintf(end, size - (size_t)(end - folded), "%.*s[%ld:%ld]", (int)prefix,
                            text[i], first, first + n);
            i += n;
        }
    }
    return folded;
}
