// Any bytes must decode as a message or be dropped. A message that is kept must encode to the same
// bytes. The first byte of the input chooses the type, the second one the size of its arrays.
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "lockstep/codec.h"

#define LARGEST_COUNT 7
#define ARRAYS 24 // of a message, at most

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(int holds) {
    if (!holds) {
        abort();
    }
}

// Gives a message arrays of `count` numbers each in memory of their own, so that a write beyond any
// end is seen.
static void open_arrays(const pm_wire_type *type, void *message, int32_t count, void **array) {
    char *m = message;
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

// Decodes into `message`; if it is kept, checks the number of bytes it encodes to, and these bytes.
#define ROUND_TRIP(type)                                              \
    do {                                                              \
        portmet_##type##_t message = {.session = 0};                  \
        open_arrays(&pm_##type##_type, &message, count, array);       \
        if (pm_##type##_decode(&message, data, size) == PM_KEEP) {    \
            uint8_t *copy = malloc(size + 1);                         \
            check(copy != NULL);                                      \
            check(pm_##type##_encode(&message, copy, size - 1) == 0); \
            check(pm_##type##_encode(&message, copy, size) == size);  \
            check(memcmp(copy, data, size) == 0);                     \
            free(copy);                                               \
        }                                                             \
    } while (0)

static void try_type(int type, int count, const uint8_t *data, size_t size) {
    void *array[ARRAYS] = {NULL};
    switch (type) {
    case 0:
        ROUND_TRIP(flux);
        break;
    case 1:
        ROUND_TRIP(tick);
        break;
    case 2:
        ROUND_TRIP(report);
        break;
    case 3:
        ROUND_TRIP(ledger);
        break;
    case 4:
        ROUND_TRIP(command);
        break;
    case 5:
        ROUND_TRIP(request);
        break;
    default:
        ROUND_TRIP(hello);
        break;
    }
    for (int i = 0; i < ARRAYS; ++i) {
        free(array[i]);
    }
}

// Puts the fingerprint of the type in front of the bytes, since random changes would hardly find
// it.
static size_t fingerprint(int type, uint8_t *to) {
    uint8_t buffer[512];
    portmet_flux_t flux = {0};
    portmet_report_t report = {.message = ""};
    portmet_command_t command = {.reason = ""};
    portmet_request_t request = {.sender = "", .channel = ""};
    portmet_hello_t hello = {.sender = ""};
    const size_t written[] = {
        type == 0 ? pm_flux_encode(&flux, buffer, sizeof buffer) : 0,
        type == 1 ? pm_tick_encode(&(portmet_tick_t){0}, buffer, sizeof buffer) : 0,
        type == 2 ? pm_report_encode(&report, buffer, sizeof buffer) : 0,
        type == 3 ? pm_ledger_encode(&(portmet_ledger_t){0}, buffer, sizeof buffer) : 0,
        type == 4 ? pm_command_encode(&command, buffer, sizeof buffer) : 0,
        type == 5 ? pm_request_encode(&request, buffer, sizeof buffer) : 0,
        type == 6 ? pm_hello_encode(&hello, buffer, sizeof buffer) : 0,
    };
    check(written[type] >= 8);
    memcpy(to, buffer, 8);
    return 8;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 2) {
        return 0;
    }
    const int type = data[0] % 7, count = data[1] % (LARGEST_COUNT + 1);
    const bool with_fingerprint = data[0] >= 7;
    data += 2;
    size -= 2;
    // Exactly as long as the message, so that a read beyond its end is seen.
    uint8_t *message = malloc(size + (with_fingerprint ? 8 : 0) + 1);
    check(message != NULL);
    const size_t head = with_fingerprint ? fingerprint(type, message) : 0;
    memcpy(message + head, data, size);
    message = realloc(message, head + size > 0 ? head + size : 1);
    check(message != NULL);
    try_type(type, count, message, head + size);
    free(message);
    return 0;
}
