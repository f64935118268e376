// An arena makes many small allocations that belong to one owner and are freed together.
//
// A failed allocation marks the arena: all later allocations return NULL as well, and
// pm_arena_status fails. A function that opens something therefore allocates all arrays, checks the
// arena once, and fills them:
//
//     pm_status pm_thing_open(pm_thing *thing, int n, const char *name, pm_arena *arena) {
//         thing->x = pm_arena_array(arena, (size_t)n, sizeof *thing->x);
//         thing->index = pm_arena_array(arena, (size_t)n, sizeof *thing->index);
//         thing->label = pm_arena_printf(arena, "thing %s", name);
//         PM_TRY(pm_arena_status(arena, "a thing of %d numbers", n));
//         for (int i = 0; i < n; ++i) {
//             thing->index[i] = i;
//         }
//         return PM_OK;
//     }
//
// Code between an allocation and the check must not follow the pointer. It may hand the pointer to
// pm_arena_strdup or pm_arena_printf, because these read nothing once the arena is marked. An array
// of pointers is filled after a check of its own.
#ifndef PM_BASE_ARENA_H
#define PM_BASE_ARENA_H

#include <stdbool.h>
#include <stddef.h>

#include "base/status.h"

typedef struct pm_arena_block pm_arena_block;

// The caller owns the storage and initialises it with zeros. An arena is not thread-safe.
typedef struct pm_arena {
    pm_arena_block *block; // the newest one, which links to the older ones
    bool failed;           // an allocation failed
} pm_arena;

// Returns `size` bytes of zeroed memory, aligned for any type; NULL when memory is exhausted, now
// or in an earlier allocation of this arena.
void *pm_arena_alloc(pm_arena *arena, size_t size);

// Returns zeroed memory for `count` elements of `size` bytes; NULL as above, or when the product
// overflows, which marks the arena as well.
void *pm_arena_array(pm_arena *arena, size_t count, size_t size);

// Copy or format text into the arena; NULL as above.
char *pm_arena_strdup(pm_arena *arena, const char *text);
char *pm_arena_printf(pm_arena *arena, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

// Returns PM_OK if no allocation of this arena failed. Otherwise fails with PM_ENOMEM and the
// description "out of memory for <what>", where `what` is a format for the arguments that follow
// it.
pm_status pm_arena_status(const pm_arena *arena, const char *what, ...)
    __attribute__((format(printf, 2, 3)));

// Frees all memory of the arena, which may then be used again.
void pm_arena_free(pm_arena *arena);

// Allocates one zeroed object for `pointer`, apart from any arena, which the caller frees:
// PM_TRY(PM_NEW(run, "a run")). It needs the declaration of calloc. PM_ENOMEM.
#define PM_NEW(pointer, what) pm_allocated((pointer) = calloc(1, sizeof *(pointer)), "%s", what)

// Ends a function that has made an object with PM_NEW: hands it to the caller at `place`, or, if an
// allocation of its member `arena` failed, frees it and returns what pm_arena_status does.
#define PM_RETURN_NEW(place, object, what)                                              \
    do {                                                                                \
        const pm_status pm_new_status_ = pm_arena_status(&(object)->arena, "%s", what); \
        if (pm_new_status_ != PM_OK) {                                                  \
            PM_DELETE(object);                                                          \
            return pm_new_status_;                                                      \
        }                                                                               \
        *(place) = (object);                                                            \
        return PM_OK;                                                                   \
    } while (0)

// Frees an object that PM_NEW has allocated, and its member `arena`. NULL is allowed.
#define PM_DELETE(object)                    \
    do {                                     \
        if ((object) != NULL) {              \
            pm_arena_free(&(object)->arena); \
            free(object);                    \
        }                                    \
    } while (0)

#endif
