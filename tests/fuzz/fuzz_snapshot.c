// Any bytes must read as a snapshot or a checkpoint, or be refused with a one-line error and
// without changing the results. The bytes are tried unchanged, and again with a valid digest at
// their end, since random changes would hardly find it.
#include <math.h>
#include <string.h>

#include "base/digest.h"
#include "bytes_file.h"
#include "store/snapshot.h"
#include "tests/fuzz/target.h"

#define MAGIC_SIZE 24
#define MOST_VALUES 3

static void try_snapshot(void) {
    for (int count = 0; count <= MOST_VALUES; ++count) {
        const pm_snapshot_key key = {.digest = 7, .layout = 9, .count = count, .owner = "run"};
        double value[MOST_VALUES] = {-1, -1, -1};
        int64_t session = -1;
        bool found = false;
        if (pm_snapshot_load(PM_FUZZ_FILE, &key, &session, value, &found) == PM_OK) {
            check(found);
        } else {
            check(session == -1 && value[0] == -1 && value[2] == -1);
            check(strchr(pm_error(), '\n') == NULL);
        }
        for (int i = 0; i < MOST_VALUES; ++i) {
            check(isfinite(value[i]));
        }
        (void)pm_snapshot_session(PM_FUZZ_FILE, &key, &session, &found);
    }
}

static void try_checkpoint(void) {
    double value[MOST_VALUES] = {-1, -1, -1};
    const pm_checkpoint_field field[] = {{"theta", 2, value}, {"position", 1, value + 2}};
    if (pm_checkpoint_load(PM_FUZZ_FILE, "fit", 7, 2, field) != PM_OK) {
        check(value[0] == -1 && value[1] == -1 && value[2] == -1);
        check(strchr(pm_error(), '\n') == NULL);
    }
}

// Mends the sum that follows head and values, unless try_load() would not accept them anyway.
static void mend_sum(uint8_t *data, size_t size) {
    int64_t head[4]; // digest, layout, session, count
    int8_t owner[PM_SNAPSHOT_OWNER];
    double value[MOST_VALUES];
    if (size < MAGIC_SIZE + sizeof head + sizeof owner) {
        return;
    }
    memcpy(head, data + MAGIC_SIZE, sizeof head);
    memcpy(owner, data + MAGIC_SIZE + sizeof head, sizeof owner);
    const size_t room = (size - MAGIC_SIZE - sizeof head - sizeof owner) / sizeof *value;
    if (head[3] < 0 || head[3] > MOST_VALUES || (size_t)head[3] >= room) {
        return;
    }
    uint8_t *at = data + MAGIC_SIZE + sizeof head + sizeof owner;
    const size_t count = (size_t)head[3];
    memcpy(value, at, count * sizeof *value);
    uint64_t sum = PM_DIGEST_INIT;
    for (int i = 0; i < 3; ++i) {
        sum = pm_digest_integer(sum, head[i]);
    }
    for (size_t i = 0; i < sizeof owner; ++i) {
        sum = pm_digest_integer(sum, owner[i]);
    }
    sum = pm_digest_doubles(sum, value, count);
    memcpy(at + count * sizeof *value, &sum, sizeof sum);
}

static void try_load(void) {
    try_snapshot();
    try_checkpoint();
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
