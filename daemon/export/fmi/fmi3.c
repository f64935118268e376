// SPDX-License-Identifier: MIT
// An exported scene as an FMU, for Model Exchange and Co-Simulation (FMI 3.0.1). model.h names the
// scene and says which value references its variables have: 0 is the time; then come the states,
// their derivatives, the inputs, the energies, the entropies, the fluxes, the co-energies dE and
// dS, the reactions, the distance to the range of the training, the ledger, and how much of the
// scene's guards is used. All are Float64.
#include "fmi3.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter" // of functions of a given interface
#if !defined(FMI3_IS_HIDDEN)
#pragma GCC visibility push(default)
#endif
#endif

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define SCENE(suffix) JOIN(MODEL_NAME, suffix)

enum {
    STATES = SCENE(_states),
    INPUTS = SCENE(_inputs),
    SUBSYSTEMS = SCENE(_subsystems),
    FLUXES = 4 * SCENE(_ports),
    FIRST_STATE = 1,
    FIRST_DERIVATIVE = FIRST_STATE + STATES,
    FIRST_INPUT = FIRST_DERIVATIVE + STATES,
    FIRST_ENERGY = FIRST_INPUT + INPUTS,
    FIRST_ENTROPY = FIRST_ENERGY + SUBSYSTEMS,
    FIRST_FLUX = FIRST_ENTROPY + SUBSYSTEMS,
    FIRST_SLOPE = FIRST_FLUX + FLUXES,
    FIRST_REACTION = FIRST_SLOPE + 2 * STATES,
    DEPARTURE = FIRST_REACTION + INPUTS / 3,
    ENERGY_CHANGE,
    ENTROPY_PRODUCED,
    POWER_RESIDUAL,
    GUARD_USED,
    END
};

typedef enum { INSTANTIATED, INITIALIZING, EVENT, CONTINUOUS, STEP, TERMINATED } phase;

// A saved state of the FMU. It holds no pointer, so that its bytes can be serialized.
typedef struct {
    MODEL_NAME scene;
    double start;    // time at which the run began
    double first[2]; // energy, J, and entropy, J/K, of all parts at that time
    phase phase;
} contents;

// Results are computed when they are first asked for.
typedef struct {
    contents now;
    bool known;
    SCENE(_results) results;
    double other;               // result that was computed last
    bool co_simulation, events; // events: an importer enters event mode before the first step
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmi3IntermediateUpdateCallback update; // NULL: inputs hold over a step
} instance;

// --- messages ---

static fmi3Status refuse(fmi3Instance i, const char *message) {
    instance *m = i;
    if (m != NULL && m->log != NULL) {
        m->log(m->environment, fmi3Error, "error", message);
    }
    return fmi3Error;
}

static bool is_in(fmi3Instance i, unsigned phases) {
    const instance *m = i;
    return m != NULL && (phases >> m->now.phase & 1u) != 0;
}

#define PHASE(x) (1u << (x))
#define RUNNING (PHASE(EVENT) | PHASE(CONTINUOUS) | PHASE(STEP))

const char *fmi3GetVersion(void) {
    return "3.0";
}

fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String names[]) {
    return i == NULL ? fmi3Error : fmi3OK;
}

// --- life ---

// Returns a sum with the bits of the program's own sums, which depend on no order: numbers are cut
// into pieces at fixed powers of two (Demmel and Nguyen, IEEE Trans. Comput. 64, 2015).
static double total(const double x[]) {
    double most = 0, part[3] = {0};
    int exponent = 0;
    for (int k = 0; k < SUBSYSTEMS; ++k) {
        most = fmax(most, fabs(x[k]));
    }
    frexp(most, &exponent);
    const int top = exponent <= -910 ? 5 : exponent >= 910 ? 75 : (exponent + 1040) / 26;
    for (int k = 0; k < SUBSYSTEMS; ++k) {
        double rest = x[k];
        for (int i = 0; i < 3; ++i) {
            const double rounder = ldexp(6755399441055744.0, 26 * (top - i - 40));
            const double piece = (rest + rounder) - rounder;
            part[i] += piece;
            rest -= piece;
        }
    }
    return part[0] + (part[1] + part[2]);
}

static fmi3Instance make(fmi3String token, fmi3InstanceEnvironment environment,
                         fmi3LogMessageCallback log) {
    if (token == NULL || strcmp(token, MODEL_TOKEN) != 0) {
        if (log != NULL) {
            log(environment, fmi3Error, "error", "the instantiation token is that of another FMU");
        }
        return NULL;
    }
    instance *m = calloc(1, sizeof *m);
    if (m != NULL) {
        m->environment = environment;
        m->log = log;
        SCENE(_init)(&m->now.scene);
    }
    return m;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    return make(token, environment, log);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    instance *m = make(token, environment, log);
    if (m != NULL) {
        m->co_simulation = true;
        m->update = n > 0 ? update : NULL;
        m->events = event_mode;
    }
    return m;
}

fmi3Instance
fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                  fmi3Boolean visible, fmi3Boolean logging,
                                  fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                  fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                  fmi3UnlockPreemptionCallback unlock) {
    if (log != NULL) {
        log(environment, fmi3Error, "error", "the FMU has no clocks to schedule");
    }
    return NULL;
}

void fmi3FreeInstance(fmi3Instance i) {
    free(i);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean has_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean has_stop, fmi3Float64 stop) {
    if (!is_in(i, PHASE(INSTANTIATED))) {
        return refuse(i, "fmi3EnterInitializationMode: the FMU is initialized already");
    }
    if (!isfinite(start)) {
        return refuse(i, "fmi3EnterInitializationMode: the start is not finite");
    }
    instance *m = i;
    m->now.start = m->now.scene.time = start;
    m->now.phase = INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance i) {
    if (!is_in(i, PHASE(INITIALIZING))) {
        return refuse(i, "fmi3ExitInitializationMode: the FMU is not in initialization mode");
    }
    instance *m = i;
    SCENE(_outputs)(m->now.scene.z, m->now.scene.u, &m->results);
    m->now.first[0] = total(m->results.energy);
    m->now.first[1] = total(m->results.entropy);
    if (!isfinite(m->now.first[0]) || !isfinite(m->now.first[1])) {
        return refuse(i,
                      "fmi3ExitInitializationMode: the states have an infinite energy or entropy");
    }
    m->now.phase = m->co_simulation && !m->events ? STEP : EVENT;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance i) {
    if (!is_in(i, RUNNING)) {
        return refuse(i, "fmi3EnterEventMode: the FMU does not run");
    }
    ((instance *)i)->now.phase = EVENT;
    return fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance i) {
    if (!is_in(i, PHASE(EVENT)) || ((instance *)i)->co_simulation) {
        return refuse(
            i, "fmi3EnterContinuousTimeMode: the FMU is not in event mode of Model Exchange");
    }
    ((instance *)i)->now.phase = CONTINUOUS;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance i) {
    if (!is_in(i, PHASE(EVENT)) || !((instance *)i)->co_simulation) {
        return refuse(i, "fmi3EnterStepMode: the FMU is not in event mode of Co-Simulation");
    }
    ((instance *)i)->now.phase = STEP;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance i) {
    if (!is_in(i, RUNNING)) {
        return refuse(i, "fmi3Terminate: the FMU does not run");
    }
    ((instance *)i)->now.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance i) {
    instance *m = i;
    if (m == NULL) {
        return fmi3Error;
    }
    memset(&m->now, 0, sizeof m->now);
    SCENE(_init)(&m->now.scene);
    m->known = false;
    return fmi3OK;
}

// --- values ---

// Returns where the result of a reference is in `results`; NULL: it is no result.
static double *result_of(SCENE(_results) * results, fmi3ValueReference r) {
    return r < FIRST_DERIVATIVE       ? NULL
           : r < FIRST_INPUT          ? &results->rate[r - FIRST_DERIVATIVE]
           : r < FIRST_ENERGY         ? NULL
           : r < FIRST_ENTROPY        ? &results->energy[r - FIRST_ENERGY]
           : r < FIRST_FLUX           ? &results->entropy[r - FIRST_ENTROPY]
           : r < FIRST_SLOPE          ? &results->flux[r - FIRST_FLUX]
           : r < FIRST_SLOPE + STATES ? &results->dE[r - FIRST_SLOPE]
           : r < FIRST_REACTION       ? &results->dS[r - FIRST_SLOPE - STATES]
           : r < DEPARTURE            ? &results->reaction[r - FIRST_REACTION]
                                      : NULL;
}

// Returns how far outside the range of the training states and inputs are. u NULL: states alone.
static double outside_range(const double z[], const double u[]) {
    return fmax(SCENE(_departure)(z), u == NULL ? 0 : SCENE(_input_departure)(u));
}

// Returns the change of the energy, J, or of the entropy, J/K, since the start, with what left to
// the outside. `now` are the results at this time.
static double change_of(const instance *m, const SCENE(_results) * now, int is_entropy) {
    const double all = total(is_entropy ? now->entropy : now->energy);
    return m->now.phase < EVENT ? 0
                                : all + m->now.scene.left[is_entropy] - m->now.first[is_entropy];
}

// Returns which part of the scene's guard of the energy is used. In Model Exchange nobody counts
// what leaves to the outside.
static double energy_guard_used(const instance *m, const SCENE(_results) * now) {
    return m->co_simulation || INPUTS == 0 ? fabs(change_of(m, now, 0)) / MODEL_ENERGY_GUARD : 0;
}

// Returns where the value of a reference is; NULL: there is no such reference.
static double *value_of(instance *m, fmi3ValueReference r) {
    if (r == 0) {
        return &m->now.scene.time;
    }
    if (r < FIRST_DERIVATIVE) {
        return &m->now.scene.z[r - FIRST_STATE];
    }
    if (r >= FIRST_INPUT && r < FIRST_ENERGY) {
        return &m->now.scene.u[r - FIRST_INPUT];
    }
    if (r == DEPARTURE) {
        m->other = outside_range(m->now.scene.z, m->now.scene.u);
        return &m->other;
    }
    if (!m->known) {
        SCENE(_outputs)(m->now.scene.z, m->now.scene.u, &m->results);
        m->known = true;
    }
    if (r == ENERGY_CHANGE || r == ENTROPY_PRODUCED) { // with what left to the outside
        m->other = change_of(m, &m->results, r == ENTROPY_PRODUCED);
        return &m->other;
    }
    if (r == GUARD_USED) {
        const double widths = SCENE(_departure)(m->now.scene.z);
        m->other = fmax(widths > 0 ? widths / MODEL_RANGE_GUARD : 0, // a guard may be 0
                        energy_guard_used(m, &m->results));
        return &m->other;
    }
    if (r == POWER_RESIDUAL) { // rate of the energy of all parts and of the outside
        static const int outside[] = {MODEL_OUTSIDE};
        const double du[INPUTS + 1] = {0};
        SCENE(_results) d;
        SCENE(_tangent)(m->now.scene.z, m->results.rate, m->now.scene.u, du, &d);
        m->other = total(d.energy);
        for (int k = 0; outside[k] >= 0; ++k) {
            m->other += m->results.flux[outside[k]];
        }
        return &m->other;
    }
    return result_of(&m->results, r);
}

fmi3Status fmi3GetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t n,
                          fmi3Float64 values[], size_t nvalues) {
    if (i == NULL || nvalues != n) {
        return refuse(i, "fmi3GetFloat64: every variable has one value");
    }
    for (size_t k = 0; k < n; ++k) {
        const double *value = value_of(i, r[k]);
        if (value == NULL) {
            return refuse(i, "fmi3GetFloat64: unknown value reference");
        }
        values[k] = *value;
    }
    return fmi3OK;
}

// States may be set before the run, and inputs at any time.
fmi3Status fmi3SetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t n,
                          const fmi3Float64 values[], size_t nvalues) {
    if (i == NULL || nvalues != n) {
        return refuse(i, "fmi3SetFloat64: every variable has one value");
    }
    instance *m = i;
    for (size_t k = 0; k < n; ++k) {
        const bool input = r[k] >= FIRST_INPUT && r[k] < FIRST_ENERGY;
        const bool state = r[k] >= FIRST_STATE && r[k] < FIRST_DERIVATIVE &&
                           is_in(i, PHASE(INSTANTIATED) | PHASE(INITIALIZING));
        if (!input && !state) {
            return refuse(i, "fmi3SetFloat64: the variable cannot be set now");
        }
        if (!isfinite(values[k])) {
            return refuse(i, "fmi3SetFloat64: the value is not finite");
        }
        *value_of(m, r[k]) = values[k];
        m->known = false;
    }
    return fmi3OK;
}

// Computes the derivatives of all results along the direction dx [STATES + INPUTS] that has the
// entries `seed` at the references `known`, each a state or an input. Returns false if one is
// neither.
static bool differentiate(instance *m, size_t nknown, const fmi3ValueReference known[],
                          const double seed[], double dx[], SCENE(_results) * d) {
    memset(dx, 0, (STATES + INPUTS) * sizeof *dx);
    for (size_t k = 0; k < nknown; ++k) {
        const fmi3ValueReference r = known[k];
        double *entry = r >= FIRST_STATE && r < FIRST_DERIVATIVE ? dx + (r - FIRST_STATE)
                        : r >= FIRST_INPUT && r < FIRST_ENERGY   ? dx + STATES + (r - FIRST_INPUT)
                                                                 : NULL;
        if (entry == NULL) {
            return false;
        }
        *entry = seed[k];
    }
    SCENE(_tangent)(m->now.scene.z, dx, m->now.scene.u, dx + STATES, d);
    return true;
}

// Returns the slope of the distance to the training range along dx, of states and inputs or of
// states alone: a difference, since it has edges.
static double departure_slope(const instance *m, const double dx[], bool with_inputs) {
    const double *const z = m->now.scene.z, *const u = m->now.scene.u;
    double there[STATES + INPUTS + 1] = {0}, size = 1, length = 0;
    for (int k = 0; k < STATES + INPUTS; ++k) {
        there[k] = k < STATES ? z[k] : u[k - STATES];
        size = fmax(size, fabs(there[k]));
        length = fmax(length, fabs(dx[k]));
    }
    const double step = length > 0 ? 1e-6 * size / length : 0;
    for (int k = 0; k < STATES + INPUTS; ++k) {
        there[k] += step * dx[k];
    }
    const double before = outside_range(z, with_inputs ? u : NULL);
    const double behind = outside_range(there, with_inputs ? there + STATES : NULL);
    return step > 0 ? (behind - before) / step : 0;
}

// Returns the slope of the used part of the guards: that of the guard of which more is used. `d`
// are the derivatives along dx.
static double guard_slope(instance *m, const double dx[], const SCENE(_results) * d) {
    const double used = *value_of(m, GUARD_USED), slope = total(d->energy) / MODEL_ENERGY_GUARD;
    const double change = change_of(m, &m->results, 0);
    return !(used > 0) || !isfinite(used) ? 0
           : energy_guard_used(m, &m->results) < used
               ? departure_slope(m, dx, false) / MODEL_RANGE_GUARD
           : change < 0 ? -slope
                        : slope;
}

// Writes the derivative of an output from what differentiate has computed. Returns false if the
// reference is none. The residual of power is zero everywhere, but for rounding.
static bool derivative_of(instance *m, const double dx[], SCENE(_results) * d, fmi3ValueReference r,
                          double *value) {
    const double *result =
        r >= FIRST_STATE && r < FIRST_DERIVATIVE ? dx + (r - FIRST_STATE) : result_of(d, r);
    *value = result != NULL          ? *result
             : r == DEPARTURE        ? departure_slope(m, dx, true)
             : r == ENERGY_CHANGE    ? total(d->energy)
             : r == ENTROPY_PRODUCED ? total(d->entropy)
             : r == GUARD_USED       ? guard_slope(m, dx, d)
                                     : 0;
    return result != NULL || (r >= DEPARTURE && r < END);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance i, const fmi3ValueReference unknown[],
                                        size_t nunknown, const fmi3ValueReference known[],
                                        size_t nknown, const fmi3Float64 seed[], size_t nseed,
                                        fmi3Float64 sensitivity[], size_t nsensitivity) {
    double dx[STATES + INPUTS + 1];
    SCENE(_results) d;
    if (i == NULL || nseed != nknown || nsensitivity != nunknown) {
        return refuse(i, "fmi3GetDirectionalDerivative: every variable has one value");
    }
    if (!differentiate(i, nknown, known, seed, dx, &d)) {
        return refuse(i, "fmi3GetDirectionalDerivative: a known is neither state nor input");
    }
    for (size_t k = 0; k < nunknown; ++k) {
        if (!derivative_of(i, dx, &d, unknown[k], sensitivity + k)) {
            return refuse(i, "fmi3GetDirectionalDerivative: an unknown has no derivative");
        }
    }
    return fmi3OK;
}

// One direction after the other: each known has a derivative of all unknowns.
fmi3Status fmi3GetAdjointDerivative(fmi3Instance i, const fmi3ValueReference unknown[],
                                    size_t nunknown, const fmi3ValueReference known[],
                                    size_t nknown, const fmi3Float64 seed[], size_t nseed,
                                    fmi3Float64 sensitivity[], size_t nsensitivity) {
    double dx[STATES + INPUTS + 1];
    SCENE(_results) d;
    if (i == NULL || nseed != nunknown || nsensitivity != nknown) {
        return refuse(i, "fmi3GetAdjointDerivative: every variable has one value");
    }
    for (size_t j = 0; j < nknown; ++j) {
        const double one = 1;
        if (!differentiate(i, 1, known + j, &one, dx, &d)) {
            return refuse(i, "fmi3GetAdjointDerivative: a known is neither state nor input");
        }
        sensitivity[j] = 0;
        for (size_t k = 0; k < nunknown; ++k) {
            double value;
            if (!derivative_of(i, dx, &d, unknown[k], &value)) {
                return refuse(i, "fmi3GetAdjointDerivative: an unknown has no derivative");
            }
            sensitivity[j] += seed[k] * value;
        }
    }
    return fmi3OK;
}

#include "fmi3_state.c"

// --- Model Exchange ---

fmi3Status fmi3SetTime(fmi3Instance i, fmi3Float64 time) {
    if (i == NULL || !isfinite(time)) {
        return refuse(i, "fmi3SetTime: the time is not finite");
    }
    ((instance *)i)->now.scene.time = time;
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance i, const fmi3Float64 z[], size_t n) {
    instance *m = i;
    if (m == NULL || n != STATES) {
        return refuse(i, "fmi3SetContinuousStates: the number of states is another");
    }
    memcpy(m->now.scene.z, z, sizeof m->now.scene.z);
    m->known = false;
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance i, fmi3Float64 z[], size_t n) {
    const instance *m = i;
    if (m == NULL || n != STATES) {
        return refuse(i, "fmi3GetContinuousStates: the number of states is another");
    }
    memcpy(z, m->now.scene.z, sizeof m->now.scene.z);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance i, fmi3Float64 rate[], size_t n) {
    instance *m = i;
    if (m == NULL || n != STATES) {
        return refuse(i, "fmi3GetContinuousStateDerivatives: the number of states is another");
    }
    SCENE(_rates)(m->now.scene.z, m->now.scene.u, rate);
    for (size_t k = 0; k < n; ++k) {
        if (!isfinite(rate[k])) {
            return fmi3Discard; // the importer takes a shorter step
        }
    }
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance i, fmi3Float64 nominal[], size_t n) {
    static const double usual[] = {MODEL_NOMINALS};
    if (i == NULL || n != STATES) {
        return refuse(i, "fmi3GetNominalsOfContinuousStates: the number of states is another");
    }
    for (size_t k = 0; k < n; ++k) {
        nominal[k] = usual[k];
    }
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance i, size_t *n) {
    *n = STATES;
    return i == NULL ? fmi3Error : fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance i, size_t *n) {
    *n = 0;
    return i == NULL ? fmi3Error : fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance i, fmi3Float64 values[], size_t n) {
    return i == NULL || n != 0 ? fmi3Error : fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance i, fmi3Boolean final, fmi3Boolean *event,
                                       fmi3Boolean *terminate) {
    *event = *terminate = false;
    return i == NULL ? fmi3Error : fmi3OK;
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance i) {
    return i == NULL ? fmi3Error : fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states,
                                    fmi3Boolean *has_next, fmi3Float64 *next) {
    *again = *terminate = *nominals = *states = *has_next = false;
    *next = 0;
    return i == NULL ? fmi3Error : fmi3OK;
}

// --- Co-Simulation ---

// Lets the importer write the inputs at a time within a step. It may read where a substep begins.
static void ask_importer(void *context, double time, int stage) {
    instance *m = context;
    bool wants_return = false;
    double return_time = time;
    m->known = false;
    m->update(m->environment, time, true, stage == 0, stage == 0, false, &wants_return,
              &return_time);
}

// Steps of the scene's length are those of the scene, bit by bit. Others are divided into substeps
// that are no longer than its own.
static void take_step(instance *m, double begin, double length) {
    const double steps = round(length / MODEL_DT);
    const bool whole = steps >= 1 && fabs(length - steps * MODEL_DT) <= 1e-9 * length;
    const double substeps = ceil(length / MODEL_DT * MODEL_SUBSTEPS);
    SCENE(_update) *update = m->update == NULL ? NULL : ask_importer;
    m->now.scene.time = begin;
    for (double k = 0; k < steps && whole; ++k) {
        SCENE(_drive)(&m->now.scene, MODEL_H, MODEL_SUBSTEPS, update, m);
    }
    if (!whole) {
        SCENE(_drive)(&m->now.scene, length / substeps, (int)substeps, update, m);
    }
    m->now.scene.time = begin + length;
    m->known = false;
}

fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 point, fmi3Float64 length, fmi3Boolean final,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *last) {
    instance *m = i;
    if (!is_in(i, PHASE(STEP))) {
        return refuse(i, "fmi3DoStep: the FMU is not in step mode");
    }
    if (!(length >= 0) || !(length < 1e6 * MODEL_DT)) {
        return refuse(i, "fmi3DoStep: the step is negative or too long");
    }
    if (!(fabs(point - m->now.scene.time) <= 1e-6 * MODEL_DT + 1e-12 * fabs(m->now.scene.time))) {
        return refuse(i, "fmi3DoStep: the step does not begin where the last one has ended");
    }
    *event = *terminate = *early = false;
    *last = point;
    const contents before = m->now;
    if (length > 0) {
        take_step(m, point, length);
    }
    for (int k = 0; k < STATES; ++k) {
        if (!isfinite(m->now.scene.z[k])) {
            m->now = before;
            return refuse(i, "fmi3DoStep: a state became infinite: the step is too long for it");
        }
    }
    if (SCENE(_departure)(m->now.scene.z) > MODEL_RANGE_GUARD) {
        m->now = before;
        return refuse(i, "fmi3DoStep: the state is further outside the training range than the "
                         "scene's guard allows");
    }
    if (MODEL_ENERGY_GUARD < HUGE_VAL && fabs(*value_of(m, ENERGY_CHANGE)) > MODEL_ENERGY_GUARD) {
        m->now = before;
        m->known = false;
        return refuse(i, "fmi3DoStep: the total energy has drifted by more than the scene's guard "
                         "allows");
    }
    *last = point + length;
    return fmi3OK;
}

#include "fmi3_unused.c"
