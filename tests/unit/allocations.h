// Counts our own allocations, for tests that the step loop makes none. Include it in one file of a
// test that is linked with -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc.
#ifndef PM_TESTS_ALLOCATIONS_H
#define PM_TESTS_ALLOCATIONS_H

#include <stddef.h>

static long allocations;

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *memory, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *memory, size_t size);

void *__wrap_malloc(size_t size) {
    ++allocations;
    return __real_malloc(size);
}

void *__wrap_calloc(size_t count, size_t size) {
    ++allocations;
    return __real_calloc(count, size);
}

void *__wrap_realloc(void *memory, size_t size) {
    ++allocations;
    return __real_realloc(memory, size);
}

#endif
