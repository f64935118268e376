// This header declares what every fuzz target shares: the function that receives the bytes, and a
// check that ends the program.
#ifndef PM_TESTS_FUZZ_TARGET_H
#define PM_TESTS_FUZZ_TARGET_H

#include <stdint.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static inline void check(int holds) {
    if (!holds) {
        abort();
    }
}

#endif
