// random_inputs RUNS SIZE [SEED [FIRST]]: a fuzz target without libFuzzer, on RUNS inputs of SIZE
// random bytes, always the same ones for a seed. For targets to which every input says something.
#include <stdio.h>
#include <stdlib.h>

#include "base/rng.h"

#define LARGEST 4096 // bytes of an input
#define SHOWN 10000  // runs between two lines

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int main(int argc, char **argv) {
    static uint8_t input[LARGEST];
    const long runs = argc > 2 ? atol(argv[1]) : 0, size = argc > 2 ? atol(argv[2]) : 0;
    if (size < 1 || size > LARGEST) {
        fprintf(stderr, "usage: random_inputs RUNS SIZE [SEED [FIRST]]\n");
        return 2;
    }
    for (long i = argc > 4 ? atol(argv[4]) : 0; i < runs; ++i) {
        pm_rng rng;
        pm_rng_init(&rng, (uint64_t)(argc > 3 ? atol(argv[3]) : 1), (uint64_t)i);
        for (long k = 0; k < size; ++k) {
            input[k] = (uint8_t)pm_rng_below(&rng, 256);
        }
        if (i % SHOWN == 0) {
            printf("%ld of %ld\n", i, runs);
            fflush(stdout);
        }
        LLVMFuzzerTestOneInput(input, (size_t)size);
    }
    return 0;
}
