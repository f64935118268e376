// An arena: many small allocations with one owner, freed together.
#ifndef PM_BASE_ARENA_H
#define PM_BASE_ARENA_H

#include <stddef.h>

typedef struct pm_arena_block pm_arena_block;

// Storage the caller owns; zero-initialise, then use. Not thread-safe.
typedef struct pm_arena {
    pm_arena_block *block;
} pm_arena;

// Zeroed memory of `size` bytes, aligned for any type; NULL when memory is exhausted.
void *pm_arena_alloc(pm_arena *arena, size_t size);

// The same for an array; NULL too when the product overflows.
void *pm_arena_array(pm_arena *arena, size_t count, size_t size);

// Copies of text; NULL when memory is exhausted. _printf formats into the arena.
char *pm_arena_strdup(pm_arena *arena, const char *text);
char *pm_arena_printf(pm_arena *arena, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

// Frees everything; the arena may be used again.
void pm_arena_free(pm_arena *arena);

#endif
