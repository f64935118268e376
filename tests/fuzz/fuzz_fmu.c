// Any bytes must be refused as the state of an FMU, or be one from which it goes on. The bytes are
// tried unchanged; and as changes to the first state, with a valid checksum, since random bytes
// would hardly be a state.
#include <string.h>

// The FMU of a shipped scene, as `portmetd export` writes it.
#include "fmi3.c"
#include "tests/fuzz/target.h"

static void try_state(fmi3Instance i, const uint8_t *data, size_t size) {
    static const fmi3ValueReference energy = FIRST_ENERGY;
    fmi3FMUState state = NULL;
    if (fmi3DeserializeFMUState(i, data, size, &state) != fmi3OK) {
        check(state == NULL);
        return;
    }
    check(fmi3SetFMUState(i, state) == fmi3OK);
    bool event, terminate, early;
    double value, last;
    fmi3Byte again[BYTES];
    check(fmi3SerializeFMUState(i, state, again, sizeof again) == fmi3OK);
    check(memcmp(again, data, size) == 0);
    (void)fmi3DoStep(i, ((instance *)i)->now.scene.time, MODEL_H, true, &event, &terminate, &early,
                     &last);
    (void)fmi3GetFloat64(i, &energy, 1, &value, 1);
    check(fmi3FreeFMUState(i, &state) == fmi3OK && state == NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static fmi3Instance i;
    static fmi3Byte first[BYTES];
    if (i == NULL) {
        i = fmi3InstantiateCoSimulation("fuzz", MODEL_TOKEN, NULL, false, false, false, false, NULL,
                                        0, NULL, NULL, NULL);
        check(i != NULL && fmi3EnterInitializationMode(i, false, 0, 0, false, 0) == fmi3OK);
        check(fmi3ExitInitializationMode(i) == fmi3OK);
        fmi3FMUState state = NULL;
        check(fmi3GetFMUState(i, &state) == fmi3OK);
        check(fmi3SerializeFMUState(i, state, first, sizeof first) == fmi3OK);
        check(fmi3FreeFMUState(i, &state) == fmi3OK);
    }
    try_state(i, data, size);
    fmi3Byte bytes[BYTES];
    memcpy(bytes, first, sizeof bytes);
    for (size_t k = 0; k < size; ++k) {
        bytes[k % BYTES] ^= data[k];
    }
    const uint64_t sum = check_sum(bytes + sizeof sum);
    memcpy(bytes, &sum, sizeof sum);
    try_state(i, bytes, sizeof bytes);
    return 0;
}
