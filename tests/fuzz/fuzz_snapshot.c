// Any bytes must read as a process's snapshot, or be refused with one line and nothing touched;
// once as they are, once with the sum at their end made right, which chance would hardly find.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/digest.h"
#include "bytes_file.h"
#include "store/snapshot.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define MAGIC_SIZE 24
#define MOST_VALUES 3

static void check(int holds) {
    if (!holds) {
        abort();
    }
}

static void try_load(void) {
    for (int count = 0; count <= MOST_VALUES; ++count) {
        double value[MOST_VALUES] = {-1, -1, -1};
        int64_t session = -1;
        bool found = false;
        if (pm_snapshot_load(PM_FUZZ_FILE, 7, &session, count, value, &found) == PM_OK) {
            check(found);
        } else {
            check(session == -1 && value[0] == -1 && value[2] == -1);
            check(strchr(pm_error(), '\n') == NULL);
        }
        for (int i = 0; i < MOST_VALUES; ++i) {
            check(isfinite(value[i]));
        }
        (void)pm_snapshot_session(PM_FUZZ_FILE, 7, &session, &found);
    }
}

// Magic; digest, session, count; values; their sum. Left alone if it is none that try_load() could
// accept.
static void mend_sum(uint8_t *data, size_t size) {
    int64_t head[3];
    double value[MOST_VALUES];
    if (size < MAGIC_SIZE + sizeof head) {
        return;
    }
    memcpy(head, data + MAGIC_SIZE, sizeof head);
    const size_t room = (size - MAGIC_SIZE - sizeof head) / sizeof *value;
    if (head[2] < 0 || head[2] > MOST_VALUES || (size_t)head[2] >= room) {
        return;
    }
    uint8_t *at = data + MAGIC_SIZE + sizeof head;
    const size_t count = (size_t)head[2];
    memcpy(value, at, count * sizeof *value);
    uint64_t sum = pm_digest_integer(PM_DIGEST_INIT, head[0]);
    sum = pm_digest_doubles(pm_digest_integer(sum, head[1]), value, count);
    memcpy(at + count * sizeof *value, &sum, sizeof sum);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    uint8_t *copy = malloc(size + 1);
    check(copy != NULL);
    memcpy(copy, data, size);
    mend_sum(copy, size);
    bytes_file(data, size);
    try_load();
    if (memcmp(copy, data, size) != 0) {
        bytes_file(copy, size);
        try_load();
    }
    free(copy);
    return 0;
}
