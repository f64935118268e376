// Feeds forged messages into a running pair of nodes and its coordinator (forged_pair.h). The input
// is a list of forgeries: when, which message, and what is changed in it.
#include "tests/fuzz/forged_pair.h"
#include "tests/fuzz/target.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    forged_figures figures = {.runs = 0};
    forged_pair_run_many(data, size, &figures);
    if (forged_pair_failures(&figures) > 0) {
        forged_pair_print(stderr, &figures);
        abort();
    }
    return 0;
}
