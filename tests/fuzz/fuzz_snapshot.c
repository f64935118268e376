// Any bytes must read as a process's snapshot, or be refused with one line and nothing touched.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bytes_file.h"
#include "store/snapshot.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(int holds) {
    if (!holds) {
        abort();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    bytes_file(data, size);
    for (int count = 0; count < 4; ++count) {
        double value[3] = {-1, -1, -1};
        int64_t session = -1;
        bool found = false;
        if (pm_snapshot_load(PM_FUZZ_FILE, 7, &session, count, value, &found) == PM_OK) {
            check(found);
        } else {
            check(session == -1 && value[0] == -1 && value[2] == -1);
            check(strchr(pm_error(), '\n') == NULL);
        }
        for (int i = 0; i < 3; ++i) {
            check(isfinite(value[i]));
        }
        (void)pm_snapshot_session(PM_FUZZ_FILE, 7, &session, &found);
    }
    return 0;
}
