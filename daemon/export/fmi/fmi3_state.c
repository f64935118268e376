// SPDX-License-Identifier: MIT
// States of the FMU: all that a run goes on from, in memory or as bytes. The bytes begin with a
// checksum (FNV-1a) of the instantiation token, which names the version of portmet and the content
// of the scene, and of what follows. Part of fmi3.c.
#include <stdint.h>

#define BYTES (sizeof(uint64_t) + sizeof(contents))

static uint64_t check_sum(const fmi3Byte *saved) {
    uint64_t sum = 0xcbf29ce484222325u;
    for (const char *c = MODEL_TOKEN; *c != '\0'; ++c) {
        sum = (sum ^ (unsigned char)*c) * 0x100000001b3u;
    }
    for (size_t k = 0; k < sizeof(contents); ++k) {
        sum = (sum ^ saved[k]) * 0x100000001b3u;
    }
    return sum;
}

fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *state) {
    const instance *m = i;
    if (m == NULL || state == NULL) {
        return fmi3Error;
    }
    if (*state == NULL) {
        *state = malloc(sizeof(contents));
    }
    if (*state == NULL) {
        return refuse(i, "fmi3GetFMUState: out of memory");
    }
    memcpy(*state, &m->now, sizeof m->now);
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState state) {
    instance *m = i;
    if (m == NULL || state == NULL) {
        return fmi3Error;
    }
    memcpy(&m->now, state, sizeof m->now);
    m->known = false;
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *state) {
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState state, size_t *size) {
    *size = BYTES;
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    if (state == NULL || size != BYTES) {
        return refuse(i, "fmi3SerializeFMUState: the size is not that of a state");
    }
    memcpy(bytes + sizeof(uint64_t), state, sizeof(contents));
    const uint64_t sum = check_sum(bytes + sizeof(uint64_t));
    memcpy(bytes, &sum, sizeof sum);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    if (state == NULL || size != BYTES) {
        return refuse(i, "fmi3DeserializeFMUState: the size is not that of a state");
    }
    const uint64_t sum = check_sum(bytes + sizeof(uint64_t));
    if (memcmp(bytes, &sum, sizeof sum) != 0) {
        return refuse(i, "fmi3DeserializeFMUState: the bytes are damaged, or of another FMU");
    }
    contents found;
    memcpy(&found, bytes + sizeof(uint64_t), sizeof found);
    if ((unsigned)found.phase > TERMINATED) {
        return refuse(i, "fmi3DeserializeFMUState: the bytes are of no phase of an FMU");
    }
    if (*state == NULL) {
        *state = malloc(sizeof(contents));
    }
    if (*state == NULL) {
        return refuse(i, "fmi3DeserializeFMUState: out of memory");
    }
    memcpy(*state, &found, sizeof found);
    return fmi3OK;
}
