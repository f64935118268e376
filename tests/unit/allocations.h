// Counts our own allocations, for tests that the step loop makes none. Include it in one file of a
// test that is linked with -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=fopen.
#ifndef PM_TESTS_ALLOCATIONS_H
#define PM_TESTS_ALLOCATIONS_H

#include <stddef.h>
#include <stdio.h>

static long allocations;

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *memory, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *memory, size_t size);

FILE *__real_fopen(const char *path, const char *mode);
FILE *__wrap_fopen(const char *path, const char *mode);

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

// A stream has a buffer.
FILE *__wrap_fopen(const char *path, const char *mode) {
    ++allocations;
    return __real_fopen(path, mode);
}

#endif
