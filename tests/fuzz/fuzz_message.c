// Any bytes must decode as a message or be dropped. A message that is kept must encode to the same
// bytes. The first byte of the input chooses the type, the second one the size of its arrays.
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "lockstep/codec.h"

#define LARGEST_COUNT 7
#define ARRAYS 12 // of numbers, in the type that has most

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(int holds) {
    if (!holds) {
        abort();
    }
}

// A message on the heap, its arrays of `count` numbers each in memory of their own, so that a write
// beyond any end is seen.
typedef struct arrays {
    double *value[ARRAYS];
    int64_t *number[3];
} arrays;

static void arrays_open(arrays *a, int count) {
    for (int i = 0; i < ARRAYS; ++i) {
        a->value[i] = malloc((size_t)count * sizeof(double) + 1);
        check(a->value[i] != NULL);
    }
    for (int i = 0; i < 3; ++i) {
        a->number[i] = malloc((size_t)count * sizeof(int64_t) + 1);
        check(a->number[i] != NULL);
    }
}

static void arrays_close(arrays *a) {
    for (int i = 0; i < ARRAYS; ++i) {
        free(a->value[i]);
    }
    free(a->number[0]);
    free(a->number[1]);
    free(a->number[2]);
}

// Decodes into `message`; if it is kept, checks the number of bytes it encodes to, and these bytes.
#define ROUND_TRIP(type, message)                                       \
    do {                                                                \
        if (pm_##type##_decode(&(message), data, size) == PM_KEEP) {    \
            uint8_t *copy = malloc(size + 1);                           \
            check(copy != NULL);                                        \
            check(pm_##type##_encode(&(message), copy, size - 1) == 0); \
            check(pm_##type##_encode(&(message), copy, size) == size);  \
            check(memcmp(copy, data, size) == 0);                       \
            free(copy);                                                 \
        }                                                               \
    } while (0)

static void try_type(int type, int count, const arrays *a, const uint8_t *data, size_t size) {
    double *const *v = a->value;
    portmet_flux_t flux = {.nend = count,
                           .energy_flux = v[0],
                           .entropy_flux = v[1],
                           .ny = count,
                           .y = v[2],
                           .e = v[3],
                           .eta = v[4],
                           .nresponse = count,
                           .response = v[5]};
    portmet_report_t report = {.npart = count,
                               .energy = v[0],
                               .entropy = v[1],
                               .bulk_energy = v[2],
                               .bulk_entropy = v[3],
                               .bulk_energy_gross = v[4],
                               .bulk_entropy_gross = v[5],
                               .evaluated = a->number[0],
                               .skipped = a->number[1],
                               .outside = a->number[2],
                               .error = v[11],
                               .nend = count,
                               .energy_flux = v[6],
                               .entropy_flux = v[7],
                               .energy_gross = v[8],
                               .entropy_gross = v[9],
                               .nz = count,
                               .z = v[10]};
    portmet_tick_t tick = {.nanswer = count, .answer = a->number[0]};
    portmet_ledger_t ledger = {0};
    portmet_command_t command = {0};
    portmet_request_t request = {0};
    portmet_hello_t hello = {0};
    switch (type) {
    case 0:
        ROUND_TRIP(flux, flux);
        break;
    case 1:
        ROUND_TRIP(tick, tick);
        break;
    case 2:
        ROUND_TRIP(report, report);
        break;
    case 3:
        ROUND_TRIP(ledger, ledger);
        break;
    case 4:
        ROUND_TRIP(command, command);
        break;
    case 5:
        ROUND_TRIP(request, request);
        break;
    default:
        ROUND_TRIP(hello, hello);
        break;
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
    arrays a;
    arrays_open(&a, count);
    try_type(type, count, &a, message, head + size);
    arrays_close(&a);
    free(message);
    return 0;
}
