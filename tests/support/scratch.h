// A temporary folder for a test's files, which is removed with its content, and helpers to read and
// write files.
#ifndef PM_TESTS_SCRATCH_H
#define PM_TESTS_SCRATCH_H

#include <assert.h>
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct scratch {
    char folder[64];
    char path[8][128];
    int count;
} scratch;

static inline void scratch_open(scratch *s) {
    *s = (scratch){.folder = "/tmp/portmet-test-XXXXXX"};
    const char *made = mkdtemp(s->folder);
    assert(made != NULL);
    (void)made;
}

// Returns the path of a file of this name in the folder; the last eight stay valid.
static inline const char *scratch_path(scratch *s, const char *name) {
    char *path = s->path[s->count++ % 8];
    assert(strlen(s->folder) + strlen(name) + 2 <= sizeof s->path[0]);
    stpcpy(stpcpy(stpcpy(path, s->folder), "/"), name);
    return path;
}

// Returns the number of files in the folder; with `remove`, deletes them.
static inline int scratch_files(const scratch *s, int remove) {
    int count = 0;
    DIR *folder = opendir(s->folder);
    for (struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL;) {
        if (entry->d_name[0] != '.') {
            count += remove ? unlinkat(dirfd(folder), entry->d_name, 0) == 0 : 1;
        }
    }
    if (folder != NULL) {
        closedir(folder);
    }
    return count;
}

static inline void scratch_close(scratch *s) {
    scratch_files(s, 1);
    rmdir(s->folder);
}

// Set-up and tear-down functions for cmocka: a folder for each test, or one for a group of tests.
static inline int scratch_setup(void **state) {
    static scratch folder;
    scratch_open(&folder);
    *state = &folder;
    return 0;
}

static inline int scratch_teardown(void **state) {
    scratch_close(*state);
    return 0;
}

static inline void scratch_write(const char *path, const void *data, size_t size) {
    FILE *file = fopen(path, "wb");
    assert(file != NULL);
    const size_t written = fwrite(data, 1, size, file);
    assert(written == size);
    (void)written;
    fclose(file);
}

// Returns the content of a file; the caller frees it.
static inline char *scratch_read(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    assert(file != NULL);
    fseek(file, 0, SEEK_END);
    *size = (size_t)ftell(file);
    rewind(file);
    char *data = malloc(*size + 1);
    const size_t got = fread(data, 1, *size, file);
    assert(got == *size);
    (void)got;
    fclose(file);
    return data;
}

#endif
