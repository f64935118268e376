// An arena is a list of blocks, the newest first. A request that does not fit opens a new block.
#include "base/arena.h"

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct pm_arena_block {
    pm_arena_block *next;
    size_t used, size;
    max_align_t memory[];
};

#define BLOCK_SIZE ((size_t)16384)

void *pm_arena_alloc(pm_arena *arena, size_t size) {
    const size_t alignment = sizeof(max_align_t);
    if (arena->failed || size > SIZE_MAX / 2) {
        arena->failed = true;
        return NULL;
    }
    size = (size + alignment - 1) / alignment * alignment;
    pm_arena_block *block = arena->block;
    if (block == NULL || block->size - block->used < size) {
        const size_t capacity = size > BLOCK_SIZE ? size : BLOCK_SIZE;
        block = calloc(1, sizeof *block + capacity);
        if (block == NULL) {
            arena->failed = true;
            return NULL;
        }
        block->size = capacity;
        block->next = arena->block;
        arena->block = block;
    }
    void *memory = (char *)block->memory + block->used;
    block->used += size;
    return memory;
}

void *pm_arena_array(pm_arena *arena, size_t count, size_t size) {
    const bool overflows = size != 0 && count > SIZE_MAX / size;
    return pm_arena_alloc(arena, overflows ? SIZE_MAX : count * size);
}

char *pm_arena_strdup(pm_arena *arena, const char *text) {
    if (arena->failed) {
        return NULL;
    }
    const size_t size = strlen(text) + 1;
    char *copy = pm_arena_alloc(arena, size);
    return copy == NULL ? NULL : memcpy(copy, text, size);
}

char *pm_arena_printf(pm_arena *arena, const char *format, ...) {
    if (arena->failed) {
        return NULL;
    }
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(NULL, 0, format, arguments);
    va_end(arguments);
    char *text = pm_arena_alloc(arena, length < 0 ? SIZE_MAX : (size_t)length + 1);
    if (text != NULL) {
        va_start(arguments, format);
        vsnprintf(text, (size_t)length + 1, format, arguments);
        va_end(arguments);
    }
    return text;
}

pm_status pm_arena_status(const pm_arena *arena, const char *what, ...) {
    if (!arena->failed) {
        return PM_OK;
    }
    char text[256];
    va_list arguments;
    va_start(arguments, what);
    vsnprintf(text, sizeof text, what, arguments);
    va_end(arguments);
    return pm_fail(PM_ENOMEM, "out of memory for %s", text);
}

void pm_arena_free(pm_arena *arena) {
    while (arena->block != NULL) {
        pm_arena_block *next = arena->block->next;
        free(arena->block);
        arena->block = next;
    }
    arena->failed = false;
}
