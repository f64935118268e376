// A mutator of libFuzzer for targets that read HDF5. It never moves bytes: the format is full of
// addresses, so that an insertion or deletion would make the file invalid at once.
#include <hdf5.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LARGEST_CHANGE 32 // bytes

int LLVMFuzzerInitialize(int *argc, char ***argv);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t most);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed);
const char *__lsan_default_suppressions(void);

// The library itself loses memory where the root of a file is damaged. What a reader leaves open is
// found below.
const char *__lsan_default_suppressions(void) {
    return "leak:libhdf5";
}

// The library allocates half a megabyte for every open file, and keeps it for the next one.
int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    return H5set_free_list_limits(-1, -1, -1, -1, -1, -1) < 0;
}

// One number after another (Numerical Recipes, 7.1).
static size_t below(unsigned *seed, size_t limit) {
    *seed = *seed * 1664525u + 1013904223u;
    return (size_t)((uint64_t)*seed * limit >> 32);
}

// One change in eight is any of libFuzzer's. Others stay within a few bytes, which seldom begin
// with a zero: most zeros are room that nothing uses.
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed) {
    if (H5Fget_obj_count(H5F_OBJ_ALL, H5F_OBJ_ALL) > 0) {
        fprintf(stderr, "ERROR: the input before this one has left an object of a file open\n");
        abort();
    }
    if (size <= LARGEST_CHANGE || below(&seed, 8) == 0) {
        return LLVMFuzzerMutate(data, size, most);
    }
    size_t at = below(&seed, size - LARGEST_CHANGE);
    const size_t length = 1 + below(&seed, LARGEST_CHANGE);
    while (data[at] == 0 && at + length < size && below(&seed, 64) > 0) {
        ++at;
    }
    uint8_t piece[LARGEST_CHANGE];
    memcpy(piece, data + at, length);
    memcpy(data + at, piece, LLVMFuzzerMutate(piece, length, length));
    return size;
}
