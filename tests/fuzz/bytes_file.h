// Writes the input of a fuzz target to the file PM_FUZZ_FILE, for readers that need a path. Each
// input replaces the one before.
#ifndef PM_TESTS_BYTES_FILE_H
#define PM_TESTS_BYTES_FILE_H

#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <unistd.h>

static inline void bytes_file(const uint8_t *data, size_t size) {
    static int file = -1;
    if (file < 0) {
        file = open(PM_FUZZ_FILE, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    }
    if (file < 0 || pwrite(file, data, size, 0) != (ssize_t)size ||
        ftruncate(file, (off_t)size) != 0) {
        abort();
    }
}

#endif
