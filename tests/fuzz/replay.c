// replay RUNS SEED-FILE...: runs a fuzz target without libFuzzer, so that every compiler can build
// it as a test. It tries each seed unchanged, and then RUNS inputs made from the seeds by a few
// random changes of a fixed seed.
#include <stdio.h>
#include <string.h>

#include "base/rng.h"
#include "tests/fuzz/target.h"

#define LARGEST 131072 // bytes of an input
#define MOST_CHANGES 8
#define MOST_ZEROS 8 // that are passed over: in HDF5 most zeros are room that nothing uses

static uint8_t seed[LARGEST], input[LARGEST];

static size_t read_seed(const char *path) {
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        perror(path);
        exit(1);
    }
    const size_t size = fread(seed, 1, sizeof seed, file);
    fclose(file);
    return size;
}

// One of: another byte, a turned bit, a piece moved, an end cut off.
static size_t change(pm_rng *rng, size_t size) {
    if (size == 0) {
        return 0;
    }
    size_t at = pm_rng_below(rng, size);
    for (int i = 0; i < MOST_ZEROS && input[at] == 0; ++i) {
        at = pm_rng_below(rng, size);
    }
    const size_t from = pm_rng_below(rng, size);
    const size_t most = size - (at > from ? at : from);
    switch (pm_rng_below(rng, 8)) {
    case 0:
    case 1:
        input[at] = (uint8_t)pm_rng_below(rng, 256);
        return size;
    case 2:
        memmove(input + at, input + from, pm_rng_below(rng, most + 1));
        return size;
    case 3:
        return at;
    default:
        input[at] ^= (uint8_t)(1u << pm_rng_below(rng, 8));
        return size;
    }
}

int main(int argc, char **argv) {
    if (argc < 3) {
        fprintf(stderr, "usage: replay RUNS SEED-FILE...\n");
        return 2;
    }
    const long runs = atol(argv[1]);
    pm_rng rng;
    pm_rng_init(&rng, 9, 0);
    for (int i = 2; i < argc; ++i) {
        const size_t size = read_seed(argv[i]);
        LLVMFuzzerTestOneInput(seed, size);
        for (long k = 0; k < runs / (argc - 2); ++k) {
            size_t changed = size;
            memcpy(input, seed, size);
            for (uint64_t n = pm_rng_below(&rng, MOST_CHANGES) + 1; n > 0; --n) {
                changed = change(&rng, changed);
            }
            // On the heap, so that a look beyond the end is seen.
            uint8_t *exact = malloc(changed + (changed == 0));
            if (exact == NULL) {
                return 1;
            }
            memcpy(exact, input, changed);
            LLVMFuzzerTestOneInput(exact, changed);
            free(exact);
        }
    }
    return 0;
}
