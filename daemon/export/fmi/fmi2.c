// SPDX-License-Identifier: MIT
// The functions of FMI 2.0.4, for Model Exchange and Co-Simulation, over those of FMI 3.0 in
// fmi3.c, which stay hidden.
#define FMI3_IS_HIDDEN
#include "fmi3.c"

#if defined(__GNUC__)
#pragma GCC visibility push(default)
#endif

typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum {
    fmi2DoStepStatus,
    fmi2PendingStatus,
    fmi2LastSuccessfulTime,
    fmi2Terminated
} fmi2StatusKind;
typedef struct {
    void (*logger)(void *environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *environment, fmi2Status status);
    void *componentEnvironment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged,
        valuesOfContinuousStatesChanged, nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

enum { MOST_ORDER = 3 }; // of the derivatives of inputs

// slope[k] are the derivatives of order k + 1 of the inputs at the beginning of the next step, and
// begin[] the inputs there.
typedef struct {
    instance *of;
    fmi2CallbackFunctions callback;
    char name[64];
    bool has_slopes;
    double start; // of the run, s
    double at, begin[INPUTS + 1], slope[MOST_ORDER][INPUTS + 1];
} component;

// The status codes of both versions are the same up to fmi2Fatal.
#define CALL(function, ...) ((fmi2Status)function(((component *)c)->of, __VA_ARGS__))
#define CALL_PLAIN(function) ((fmi2Status)function(((component *)c)->of))

static fmi2Status refuse2(fmi2Component c, const char *message) {
    return (fmi2Status)refuse(((component *)c)->of, message);
}

const char *fmi2GetVersion(void) {
    return "2.0";
}

const char *fmi2GetTypesPlatform(void) {
    return "default";
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n,
                               const fmi2String names[]) {
    return CALL(fmi3SetDebugLogging, on != 0, n, names);
}

// --- life ---

static void pass_message(void *environment, fmi3Status status, fmi3String category,
                         fmi3String message) {
    component *c = environment;
    c->callback.logger(c->callback.componentEnvironment, c->name, (fmi2Status)status, category,
                       "%s", message);
}

// The inputs within a step follow the derivatives that the importer has given.
static void follow(void *environment, double time, bool set_requested, bool get_allowed,
                   bool finished, bool may_return, bool *wants_return, double *return_time) {
    component *c = environment;
    double *u = c->of->now.scene.u;
    for (int i = 0; i < INPUTS; ++i) {
        double term = 1;
        u[i] = c->begin[i];
        for (int k = 0; k < MOST_ORDER; ++k) {
            term *= (time - c->at) / (k + 1);
            u[i] += c->slope[k][i] * term;
        }
    }
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token,
                              fmi2String resources, const fmi2CallbackFunctions *callback,
                              fmi2Boolean visible, fmi2Boolean logging) {
    component *c = calloc(1, sizeof *c);
    if (c == NULL) {
        return NULL;
    }
    if (callback != NULL) {
        c->callback = *callback;
    }
    snprintf(c->name, sizeof c->name, "%s", name == NULL ? "" : name);
    fmi3LogMessageCallback log = c->callback.logger == NULL ? NULL : pass_message;
    c->of = type == fmi2CoSimulation
                ? fmi3InstantiateCoSimulation(name, token, resources, visible != 0, logging != 0,
                                              false, false, NULL, 0, c, log, NULL)
                : fmi3InstantiateModelExchange(name, token, resources, visible != 0, logging != 0,
                                               c, log);
    if (c->of == NULL) {
        free(c);
        return NULL;
    }
    return c;
}

void fmi2FreeInstance(fmi2Component c) {
    if (c != NULL) {
        fmi3FreeInstance(((component *)c)->of);
        free(c);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    ((component *)c)->start = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return CALL(fmi3EnterInitializationMode, false, 0, ((component *)c)->start, false, 0);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return CALL_PLAIN(fmi3ExitInitializationMode);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    return CALL_PLAIN(fmi3Terminate);
}

fmi2Status fmi2Reset(fmi2Component c) {
    component *m = c;
    m->has_slopes = false;
    memset(m->slope, 0, sizeof m->slope);
    return CALL_PLAIN(fmi3Reset);
}

// --- values ---

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
    return CALL(fmi3GetFloat64, r, n, v, n);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n,
                       const fmi2Real v[]) {
    return CALL(fmi3SetFloat64, r, n, v, n);
}

#define NONE(NAME, T)                                                                          \
    fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2ValueReference r[], size_t n, T v[]) { \
        return n == 0 ? fmi2OK : refuse2(c, "fmi2Get" #NAME ": all variables are Real");       \
    }                                                                                          \
    fmi2Status fmi2Set##NAME(fmi2Component c, const fmi2ValueReference r[], size_t n,          \
                             const T v[]) {                                                    \
        return n == 0 ? fmi2OK : refuse2(c, "fmi2Set" #NAME ": all variables are Real");       \
    }
NONE(Integer, fmi2Integer)
NONE(Boolean, fmi2Boolean)
NONE(String, fmi2String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t nunknown, const fmi2ValueReference known[],
                                        size_t nknown, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    return CALL(fmi3GetDirectionalDerivative, unknown, nunknown, known, nknown, seed, nknown,
                sensitivity, nunknown);
}

// --- states of the FMU ---

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return CALL(fmi3GetFMUState, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    return CALL(fmi3SetFMUState, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return CALL(fmi3FreeFMUState, state);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    return CALL(fmi3SerializedFMUStateSize, state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size) {
    return CALL(fmi3SerializeFMUState, state, (fmi3Byte *)bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state) {
    return CALL(fmi3DeserializeFMUState, (const fmi3Byte *)bytes, size, state);
}

// --- Model Exchange ---

fmi2Status fmi2EnterEventMode(fmi2Component c) {
    return CALL_PLAIN(fmi3EnterEventMode);
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    return CALL_PLAIN(fmi3EnterContinuousTimeMode);
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean final, fmi2Boolean *event,
                                       fmi2Boolean *terminate) {
    *event = *terminate = 0;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    return CALL(fmi3SetTime, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real z[], size_t n) {
    return CALL(fmi3SetContinuousStates, z, n);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real z[], size_t n) {
    return CALL(fmi3GetContinuousStates, z, n);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real rate[], size_t n) {
    return CALL(fmi3GetContinuousStateDerivatives, rate, n);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real values[], size_t n) {
    return CALL(fmi3GetEventIndicators, values, n);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n) {
    return CALL(fmi3GetNominalsOfContinuousStates, nominal, n);
}

// --- Co-Simulation ---

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real v[]) {
    component *m = c;
    for (size_t k = 0; k < n; ++k) {
        if (r[k] < FIRST_INPUT || r[k] >= FIRST_ENERGY || order[k] < 1 || order[k] > MOST_ORDER ||
            !isfinite(v[k])) {
            return refuse2(c, "fmi2SetRealInputDerivatives: no input, or no order from 1 to 3");
        }
        m->slope[order[k] - 1][r[k] - FIRST_INPUT] = v[k];
        m->has_slopes = true;
    }
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real v[]) {
    return CALL(fmi3GetOutputDerivatives, r, n, order, v, n);
}

// The derivatives of the inputs hold for this step alone.
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean keeps) {
    component *m = c;
    bool event, terminate, early;
    double last;
    m->at = time;
    memcpy(m->begin, m->of->now.scene.u, INPUTS * sizeof *m->begin);
    m->of->update = m->has_slopes ? follow : NULL;
    const fmi2Status status =
        CALL(fmi3DoStep, time, length, keeps != 0, &event, &terminate, &early, &last);
    m->of->update = NULL;
    m->has_slopes = false;
    memset(m->slope, 0, sizeof m->slope);
    return status;
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    return refuse2(c, "fmi2CancelStep: steps are not asynchronous");
}

#define NO_STATUS(NAME, T)                                                           \
    fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2StatusKind kind, T *value) { \
        return fmi2Discard; /* steps are not asynchronous */                         \
    }
NO_STATUS(Status, fmi2Status)
NO_STATUS(RealStatus, fmi2Real)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(BooleanStatus, fmi2Boolean)
NO_STATUS(StringStatus, fmi2String)
