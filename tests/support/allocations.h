// Counts our own allocations, for tests that the step loop makes none, and lets one of them fail.
// Include it in one file of a test that is linked with
// -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=fopen.
#ifndef PM_TESTS_ALLOCATIONS_H
#define PM_TESTS_ALLOCATIONS_H

#include <stddef.h>
#include <stdio.h>

static long allocations;
static long failing; // of them, counted from 1; 0: none

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *memory, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *memory, size_t size);

FILE *__real_fopen(const char *path, const char *mode);
FILE *__wrap_fopen(const char *path, const char *mode);

void *__wrap_malloc(size_t size) {
    return ++allocations == failing ? NULL : __real_malloc(size);
}

void *__wrap_calloc(size_t count, size_t size) {
    return ++allocations == failing ? NULL : __real_calloc(count, size);
}

void *__wrap_realloc(void *memory, size_t size) {
    return ++allocations == failing ? NULL : __real_realloc(memory, size);
}

// A stream has a buffer.
FILE *__wrap_fopen(const char *path, const char *mode) {
    return ++allocations == failing ? NULL : __real_fopen(path, mode);
}

#endif
