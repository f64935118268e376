// Any bytes must decode as a message or be dropped. A message that is kept must encode to the same
// bytes. The first byte of the input chooses one of pm_wire_types, the second one the size of its
// arrays.
#include <stdbool.h>
#include <string.h>

#include "lockstep/codec.h"
#include "tests/fuzz/target.h"

#define LARGEST_COUNT 7
#define ARRAYS 24 // of a message, at most
#define FINGERPRINT 8

// A message of any type.
typedef union any_message {
    portmet_hello_t hello;
    portmet_flux_t flux;
    portmet_tick_t tick;
    portmet_input_t input;
    portmet_report_t report;
    portmet_ledger_t ledger;
    portmet_command_t command;
    portmet_request_t request;
    portmet_vitals_t vitals;
    portmet_health_t health;
    portmet_control_t control;
    portmet_control_reply_t control_reply;
} any_message;

// Gives a message arrays of `count` numbers each in memory of their own, so that a write beyond any
// end is seen.
static void open_arrays(const pm_wire_type *type, any_message *message, int32_t count,
                        void **array) {
    char *m = (char *)message;
    int n = 0;
    for (int i = 0; i < type->nfield; ++i) {
        const pm_wire_field *f = &type->field[i];
        if (f->kind == PM_WIRE_COUNT) {
            memcpy(m + f->offset, &count, sizeof count);
        } else if (f->kind == PM_WIRE_DOUBLES || f->kind == PM_WIRE_I64S) {
            check(n < ARRAYS);
            array[n] = malloc((size_t)count * sizeof(double) + 1);
            check(array[n] != NULL);
            memcpy(m + f->offset, &array[n++], sizeof *array);
        }
    }
}

// Decodes the bytes; if they are kept, checks the number of bytes that the message encodes to, and
// these bytes.
static void try_type(const pm_wire_type *type, bool exact, int count, const uint8_t *data,
                     size_t size) {
    void *array[ARRAYS] = {NULL};
    any_message message = {.hello = {0}};
    open_arrays(type, &message, count, array);
    if (pm_wire_decode(type, exact, &message, data, size) == PM_KEEP) {
        uint8_t *copy = malloc(size);
        check(copy != NULL);
        check(pm_wire_size(type, &message) == size);
        check(pm_wire_encode(type, &message, copy, size - 1) == 0);
        check(pm_wire_encode(type, &message, copy, size) == size);
        check(memcmp(copy, data, size) == 0);
        free(copy);
    }
    for (int i = 0; i < ARRAYS; ++i) {
        free(array[i]);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    int ntype = 0;
    while (pm_wire_types[ntype] != NULL) {
        ++ntype;
    }
    if (size < 2) {
        return 0;
    }
    const pm_wire_type *type = pm_wire_types[data[0] % ntype];
    const int count = data[1] % (LARGEST_COUNT + 1);
    // Random changes would hardly find the fingerprint, so that most messages are given theirs.
    const size_t head = data[0] < ntype ? 0 : FINGERPRINT;
    data += 2;
    size -= 2;
    // Exactly as long as the message, so that a read beyond its end is seen.
    uint8_t *message = malloc(head + size + (head + size == 0));
    check(message != NULL);
    for (size_t i = 0; i < head; ++i) {
        message[i] = (uint8_t)((uint64_t)type->fingerprint() >> (8 * (FINGERPRINT - 1 - i)));
    }
    memcpy(message + head, data, size);
    try_type(type, true, count, message, head + size);
    try_type(type, false, count, message, head + size);
    free(message);
    return 0;
}
