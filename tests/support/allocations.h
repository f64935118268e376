// Counts the allocations of the program under test, for tests that steps allocate nothing, and can
// make one of them fail. One file of the test includes it; the test is linked with
// -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=fopen.
#ifndef PM_TESTS_ALLOCATIONS_H
#define PM_TESTS_ALLOCATIONS_H

#include <stddef.h>
#include <stdio.h>

static long allocations;
static long failing; // number of the allocation that fails, counted from 1; 0: none

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

// Opening a stream allocates its buffer.
FILE *__wrap_fopen(const char *path, const char *mode) {
    return ++allocations == failing ? NULL : __real_fopen(path, mode);
}

#endif
