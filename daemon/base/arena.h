// An arena makes many small allocations that belong to one owner and are freed together.
#ifndef PM_BASE_ARENA_H
#define PM_BASE_ARENA_H

#include <stddef.h>

typedef struct pm_arena_block pm_arena_block;

// The caller owns the storage and initialises it with zeros. An arena is not thread-safe.
typedef struct pm_arena {
    pm_arena_block *block; // the newest one, which links to the older ones
} pm_arena;

// Returns `size` bytes of zeroed memory, aligned for any type; NULL when memory is exhausted.
void *pm_arena_alloc(pm_arena *arena, size_t size);

// Returns zeroed memory for `count` elements of `size` bytes; NULL when memory is exhausted or the
// product overflows.
void *pm_arena_array(pm_arena *arena, size_t count, size_t size);

// Copy or format text into the arena; NULL when memory is exhausted.
char *pm_arena_strdup(pm_arena *arena, const char *text);
char *pm_arena_printf(pm_arena *arena, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

// Frees all memory of the arena, which may then be used again.
void pm_arena_free(pm_arena *arena);

#endif
