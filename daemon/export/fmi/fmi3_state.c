// States of the FMU: all that a run goes on from, in memory or as bytes. Part of fmi3.c.

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
    (void)i;
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState state, size_t *size) {
    (void)i;
    (void)state;
    *size = sizeof(contents);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    if (state == NULL || size != sizeof(contents)) {
        return refuse(i, "fmi3SerializeFMUState: the size is not that of a state");
    }
    memcpy(bytes, state, size);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    if (state == NULL || size != sizeof(contents)) {
        return refuse(i, "fmi3DeserializeFMUState: the size is not that of a state");
    }
    if (*state == NULL) {
        *state = malloc(sizeof(contents));
    }
    if (*state == NULL) {
        return refuse(i, "fmi3DeserializeFMUState: out of memory");
    }
    memcpy(*state, bytes, size);
    return fmi3OK;
}
