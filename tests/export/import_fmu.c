// import_fmu LIBRARY TOKEN SCENE FINE STEPS: imports the FMU of a scene. As Co-Simulation it has
// the bits of the scene in libportmet, also from a saved state and after a reset; as Model
// Exchange, integrated by CVODE, it has the states of FINE, the same scene with many substeps. Its
// directional derivatives are the differences of its rates.
#include <cvode/cvode.h>
#include <dlfcn.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include "export/fmi/fmi3.h"
#include "library/portmet.h"

#define TOLERANCE 1e-10 // relative, of CVODE
#define SMALL 1e-14     // absolute, of CVODE: entropies are small
#define AGREEMENT 1e-6  // of states, relative to the largest: what CVODE's tolerance grows to
#define DIFFERENCE 1e-6 // of derivatives, relative: that of a central difference

typedef struct fmu {
    void *library;
    fmi3Instance me, cs;
    size_t n;
} fmu;

static void stop(const char *text) {
    printf("FAILED: %s\n", text);
    exit(1);
}

static void require(fmi3Status status, const char *what) {
    if (status != fmi3OK) {
        stop(what);
    }
}

static void hear(fmi3InstanceEnvironment e, fmi3Status status, fmi3String category,
                 fmi3String text) {
    (void)e;
    (void)category;
    printf("the FMU says (%d): %s\n", (int)status, text);
}

// Returns a function of the FMU.
static void *find(const fmu *f, const char *name) {
    void *address = dlsym(f->library, name);
    if (address == NULL) {
        printf("FAILED: no function %s\n", name);
        exit(1);
    }
    return address;
}

typedef fmi3Status plain(fmi3Instance);
typedef fmi3Status begin(fmi3Instance, bool, double, double, bool, double);
typedef fmi3Status numbers(fmi3Instance, double *, size_t);
typedef fmi3Status values(fmi3Instance, const fmi3ValueReference *, size_t, double *, size_t);
typedef fmi3Status do_step(fmi3Instance, double, double, bool, bool *, bool *, bool *, double *);
typedef fmi3Status state(fmi3Instance, fmi3FMUState *);
typedef fmi3Status set_state(fmi3Instance, fmi3FMUState);
typedef fmi3Status derivative(fmi3Instance, const fmi3ValueReference *, size_t,
                              const fmi3ValueReference *, size_t, const double *, size_t, double *,
                              size_t);
// dlsym gives no pointers to functions in ISO C; POSIX allows the conversion.
#define CALL(f, type, name) (*(type *)(uintptr_t)find(f, name))

static void open_fmu(fmu *f, const char *path, const char *token) {
    f->library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (f->library == NULL) {
        stop(dlerror());
    }
    if (strcmp(((const char *(*)(void))(uintptr_t)find(f, "fmi3GetVersion"))(), "3.0") != 0) {
        stop("version");
    }
    typedef fmi3Instance make_me(const char *, const char *, const char *, bool, bool, void *,
                                 fmi3LogMessageCallback);
    typedef fmi3Instance make_cs(const char *, const char *, const char *, bool, bool, bool, bool,
                                 const fmi3ValueReference *, size_t, void *, fmi3LogMessageCallback,
                                 fmi3IntermediateUpdateCallback);
    make_me *me = (make_me *)(uintptr_t)find(f, "fmi3InstantiateModelExchange");
    make_cs *cs = (make_cs *)(uintptr_t)find(f, "fmi3InstantiateCoSimulation");
    if (me("x", "another", NULL, false, false, NULL, NULL) != NULL) {
        stop("a foreign token is accepted");
    }
    f->me = me("me", token, NULL, false, false, NULL, hear);
    f->cs = cs("cs", token, NULL, false, false, false, false, NULL, 0, NULL, hear, NULL);
    if (f->me == NULL || f->cs == NULL) {
        stop("the FMU cannot be instantiated");
    }
    typedef fmi3Status count(fmi3Instance, size_t *);
    require(CALL(f, count, "fmi3GetNumberOfContinuousStates")(f->me, &f->n), "number of states");
}

static void start(const fmu *f, fmi3Instance i) {
    if (CALL(f, begin, "fmi3EnterInitializationMode")(i, false, 0, NAN, false, 0) == fmi3OK) {
        stop("a run begins at no time");
    }
    require(CALL(f, begin, "fmi3EnterInitializationMode")(i, false, 0, 0, false, 0),
            "initialization");
    // States of an infinite energy are no start, and the first ones are one again.
    fmi3ValueReference *place = calloc(f->n, sizeof *place);
    double *first = calloc(f->n, sizeof *first), *far = calloc(f->n, sizeof *far);
    for (size_t k = 0; k < f->n; ++k) {
        place[k] = (fmi3ValueReference)(1 + k);
        far[k] = 1e200;
    }
    require(CALL(f, values, "fmi3GetFloat64")(i, place, f->n, first, f->n), "states");
    require(CALL(f, values, "fmi3SetFloat64")(i, place, f->n, far, f->n), "states far away");
    if (CALL(f, plain, "fmi3ExitInitializationMode")(i) == fmi3OK) {
        stop("a run begins with an infinite energy");
    }
    require(CALL(f, values, "fmi3SetFloat64")(i, place, f->n, first, f->n), "the states again");
    free(place);
    free(first);
    free(far);
    require(CALL(f, plain, "fmi3ExitInitializationMode")(i), "end of initialization");
}

// --- Co-Simulation ---

// Gives the inputs of step k, up to a tenth away from `first`, to the FMU, and to `held` for the
// scene. They hold over the step.
static void drive(const fmu *f, const double *first, double *held, size_t ninput, long k) {
    for (size_t i = 0; i < ninput; ++i) {
        const fmi3ValueReference r = (fmi3ValueReference)(1 + 2 * f->n + i);
        double value = first[i] * (1 + 0.1 * sin(0.3 * (double)k + (double)i));
        held[i] = value;
        require(CALL(f, values, "fmi3SetFloat64")(f->cs, &r, 1, &value, 1), "an input");
    }
}

static void compare(const fmu *f, const portmet_scene *scene, size_t ninput, long k) {
    size_t nz, ns;
    const double *z = portmet_scene_array(scene, PORTMET_STATE, &nz);
    const double *energy = portmet_scene_array(scene, PORTMET_ENERGY, &ns);
    const double *entropy = portmet_scene_array(scene, PORTMET_ENTROPY, NULL);
    for (size_t i = 0; i < nz + 2 * ns; ++i) {
        const size_t place = i < nz ? 1 + i : 1 + 2 * nz + ninput + (i - nz);
        const fmi3ValueReference r = (fmi3ValueReference)place;
        const double expected = i < nz ? z[i] : i < nz + ns ? energy[i - nz] : entropy[i - nz - ns];
        double found;
        require(CALL(f, values, "fmi3GetFloat64")(f->cs, &r, 1, &found, 1), "a value");
        if (memcmp(&found, &expected, sizeof found) != 0) {
            printf("FAILED: step %ld, value %zu: %.17g, expected %.17g\n", k, place, found,
                   expected);
            exit(1);
        }
    }
    // The ledger: changes of the energy and of the entropy, with what left to the outside.
    size_t nflux;
    const double *ledger = portmet_scene_array(scene, PORTMET_LEDGER, NULL);
    portmet_scene_array(scene, PORTMET_FLUX, &nflux);
    for (int i = 0; i < 2; ++i) {
        const fmi3ValueReference r =
            (fmi3ValueReference)(2 + 4 * nz + ninput + ninput / 3 + 2 * ns + nflux / 2) +
            (fmi3ValueReference)i;
        const double expected = i == 0
                                    ? ledger[PORTMET_TOTAL_ENERGY] - ledger[PORTMET_FIRST_ENERGY]
                                    : ledger[PORTMET_TOTAL_ENTROPY] - ledger[PORTMET_FIRST_ENTROPY];
        double found;
        require(CALL(f, values, "fmi3GetFloat64")(f->cs, &r, 1, &found, 1), "the ledger");
        if (memcmp(&found, &expected, sizeof found) != 0) {
            printf("FAILED: step %ld, ledger %d: %.17g, expected %.17g\n", k, i, found, expected);
            exit(1);
        }
    }
}

static void step_both(const fmu *f, portmet_scene *scene, const double *first, size_t ninput,
                      long from, long to) {
    double *held = portmet_scene_inputs(scene, NULL), last;
    const double dt = portmet_scene_dt(scene);
    bool event, end, early;
    for (long k = from; k < to; ++k) {
        compare(f, scene, ninput, k);
        drive(f, first, held, ninput, k);
        require(CALL(f, do_step, "fmi3DoStep")(f->cs, (double)k * dt, dt, true, &event, &end,
                                               &early, &last),
                "fmi3DoStep");
        if (portmet_scene_step(scene, 1) != PORTMET_OK || event || end || early) {
            stop(portmet_error());
        }
    }
    compare(f, scene, ninput, to);
}

// Steps that begin elsewhere, and bytes that are no state of this FMU, are refused and change
// nothing.
static void misuse(const fmu *f, const fmi3Byte *bytes, size_t size, double time, double dt) {
    typedef fmi3Status restore(fmi3Instance, const fmi3Byte *, size_t, fmi3FMUState *);
    const double wrong[][2] = {{time + dt, dt}, {0, dt},     {NAN, dt},    {1e6, dt},
                               {time, NAN},     {time, -dt}, {time, 1e12}, {INFINITY, dt}};
    const fmi3ValueReference all[] = {0, 1};
    double before[2], after[2], last;
    bool event, end, early;
    require(CALL(f, values, "fmi3GetFloat64")(f->cs, all, 2, before, 2), "values");
    for (size_t k = 0; k < sizeof wrong / sizeof *wrong; ++k) {
        if (CALL(f, do_step, "fmi3DoStep")(f->cs, wrong[k][0], wrong[k][1], true, &event, &end,
                                           &early, &last) == fmi3OK) {
            stop("fmi3DoStep takes a wrong step");
        }
    }
    fmi3Byte *damaged = malloc(size);
    for (size_t k = 0; k < size; k += 1 + size / 500) {
        fmi3FMUState made = NULL;
        memcpy(damaged, bytes, size);
        damaged[k] ^= 0x10;
        if (CALL(f, restore, "fmi3DeserializeFMUState")(f->cs, damaged, size, &made) == fmi3OK ||
            made != NULL) {
            stop("fmi3DeserializeFMUState takes damaged bytes");
        }
    }
    free(damaged);
    require(CALL(f, values, "fmi3GetFloat64")(f->cs, all, 2, after, 2), "values");
    if (memcmp(before, after, sizeof before) != 0) {
        stop("a refused call has changed the FMU");
    }
}

// Goes on from a state that was saved as bytes, and once more from the beginning.
static void co_simulate(const fmu *f, portmet_scene *scene, long steps) {
    typedef fmi3Status size_of(fmi3Instance, fmi3FMUState, size_t *);
    typedef fmi3Status save(fmi3Instance, fmi3FMUState, fmi3Byte *, size_t);
    typedef fmi3Status restore(fmi3Instance, const fmi3Byte *, size_t, fmi3FMUState *);
    size_t ninput = 0, size = 0;
    (void)portmet_scene_inputs(scene, &ninput);
    double *first = calloc(ninput + 1, sizeof *first);
    fmi3FMUState saved = NULL, again = NULL;
    for (size_t i = 0; i < ninput; ++i) {
        const fmi3ValueReference r = (fmi3ValueReference)(1 + 2 * f->n + i);
        require(CALL(f, values, "fmi3GetFloat64")(f->cs, &r, 1, &first[i], 1), "an input");
    }
    start(f, f->cs);
    step_both(f, scene, first, ninput, 0, steps / 2);
    require(CALL(f, state, "fmi3GetFMUState")(f->cs, &saved), "a state of the FMU");
    require(CALL(f, size_of, "fmi3SerializedFMUStateSize")(f->cs, saved, &size), "its size");
    fmi3Byte *bytes = malloc(size);
    require(CALL(f, save, "fmi3SerializeFMUState")(f->cs, saved, bytes, size), "its bytes");
    double last, dt = portmet_scene_dt(scene);
    bool event, end, early;
    const double time = (double)(steps / 2) * dt;
    misuse(f, bytes, size, time, dt);
    require(
        CALL(f, do_step, "fmi3DoStep")(f->cs, time, 0.7 * dt, true, &event, &end, &early, &last),
        "a step of another length");
    require(CALL(f, restore, "fmi3DeserializeFMUState")(f->cs, bytes, size, &again),
            "a restored state");
    require(CALL(f, set_state, "fmi3SetFMUState")(f->cs, again), "a set state");
    step_both(f, scene, first, ninput, steps / 2, steps);
    require(CALL(f, plain, "fmi3Terminate")(f->cs), "fmi3Terminate");
    require(CALL(f, plain, "fmi3Reset")(f->cs), "fmi3Reset");
    require(CALL(f, state, "fmi3FreeFMUState")(f->cs, &saved), "a freed state");
    require(CALL(f, state, "fmi3FreeFMUState")(f->cs, &again), "a freed state");
    for (size_t i = 0; i < ninput; ++i) {
        portmet_scene_inputs(scene, NULL)[i] = NAN;
    }
    start(f, f->cs);
    if (portmet_scene_restart(scene, NULL) != PORTMET_OK) {
        stop(portmet_error());
    }
    step_both(f, scene, first, ninput, 0, 3);
    free(bytes);
    free(first);
}

// --- Model Exchange ---

static int rate(double t, N_Vector z, N_Vector zdot, void *context) {
    const fmu *f = context;
    typedef fmi3Status set_time(fmi3Instance, double);
    if (CALL(f, set_time, "fmi3SetTime")(f->me, t) != fmi3OK ||
        CALL(f, numbers, "fmi3SetContinuousStates")(f->me, N_VGetArrayPointer(z), f->n) != fmi3OK) {
        return -1;
    }
    return CALL(f, numbers, "fmi3GetContinuousStateDerivatives")(f->me, N_VGetArrayPointer(zdot),
                                                                 f->n) == fmi3OK
               ? 0
               : 1;
}

// The Jacobian, column by column, from the directional derivatives.
static int jacobian(double t, N_Vector z, N_Vector zdot, SUNMatrix matrix, void *context,
                    N_Vector a, N_Vector b, N_Vector c) {
    const fmu *f = context;
    (void)a;
    (void)b;
    (void)c;
    if (rate(t, z, zdot, context) != 0) {
        return 1;
    }
    fmi3ValueReference *unknown = malloc(f->n * sizeof *unknown);
    for (size_t i = 0; i < f->n; ++i) {
        unknown[i] = (fmi3ValueReference)(1 + f->n + i);
    }
    fmi3Status status = fmi3OK;
    for (size_t i = 0; i < f->n && status == fmi3OK; ++i) {
        const fmi3ValueReference known = (fmi3ValueReference)(1 + i);
        const double one = 1;
        status = CALL(f, derivative, "fmi3GetDirectionalDerivative")(
            f->me, unknown, f->n, &known, 1, &one, 1,
            SUNDenseMatrix_Column(matrix, (sunindextype)i), f->n);
    }
    free(unknown);
    return status == fmi3OK ? 0 : -1;
}

// Compares the Jacobian with central differences of the rates.
static void check_jacobian(const fmu *f, N_Vector z, N_Vector zdot, SUNMatrix matrix) {
    double *low = malloc(f->n * sizeof *low), largest = 0;
    if (jacobian(0, z, zdot, matrix, (void *)(uintptr_t)f, NULL, NULL, NULL) != 0) {
        stop("fmi3GetDirectionalDerivative");
    }
    for (size_t i = 0; i < f->n * f->n; ++i) {
        largest = fmax(largest, fabs(SUNDenseMatrix_Data(matrix)[i]));
    }
    for (size_t j = 0; j < f->n; ++j) {
        double *entry = N_VGetArrayPointer(z) + j, kept = *entry;
        const double h = 1e-6;
        *entry = kept - h;
        rate(0, z, zdot, (void *)(uintptr_t)f);
        memcpy(low, N_VGetArrayPointer(zdot), f->n * sizeof *low);
        *entry = kept + h;
        rate(0, z, zdot, (void *)(uintptr_t)f);
        *entry = kept;
        for (size_t i = 0; i < f->n; ++i) {
            const double slope = (N_VGetArrayPointer(zdot)[i] - low[i]) / (2 * h);
            if (!(fabs(slope - SUNDenseMatrix_Column(matrix, (sunindextype)j)[i]) <=
                  DIFFERENCE * largest)) {
                stop("a directional derivative is not the slope of the rates");
            }
        }
    }
    free(low);
}

// Compares the derivatives of the change of the energy, of the entropy produced and of the residual
// of power with central differences. The distance to the training range, which comes before them,
// has edges: its derivative is finite.
static void check_ledger(const fmu *f, portmet_scene *scene, N_Vector z, N_Vector zdot) {
    size_t ninput, ns, nflux;
    (void)portmet_scene_inputs(scene, &ninput);
    portmet_scene_array(scene, PORTMET_ENERGY, &ns);
    portmet_scene_array(scene, PORTMET_FLUX, &nflux);
    const size_t first = 1 + 4 * f->n + ninput + ninput / 3 + 2 * ns + nflux / 2;
    for (size_t k = 0; k < 4 * f->n; ++k) {
        const fmi3ValueReference unknown = (fmi3ValueReference)(first + k % 4);
        const fmi3ValueReference known = (fmi3ValueReference)(1 + k / 4);
        const double one = 1, h = 1e-5;
        double *entry = N_VGetArrayPointer(z) + k / 4, kept = *entry, found = NAN, value[2];
        require(CALL(f, derivative, "fmi3GetDirectionalDerivative")(f->me, &unknown, 1, &known, 1,
                                                                    &one, 1, &found, 1),
                "a derivative of the ledger");
        for (int side = 0; side < 2; ++side) {
            *entry = kept + (side == 0 ? -h : h);
            rate(0, z, zdot, (void *)(uintptr_t)f);
            require(CALL(f, values, "fmi3GetFloat64")(f->me, &unknown, 1, &value[side], 1),
                    "a value of the ledger");
        }
        *entry = kept;
        rate(0, z, zdot, (void *)(uintptr_t)f);
        const double slope = (value[1] - value[0]) / (2 * h);
        const bool close = fabs(slope - found) <= 1e-4 * fmax(1, fabs(slope));
        if (!isfinite(found) || (k % 4 > 0 && !close)) {
            printf("FAILED: output %zu of state %zu: derivative %g, slope %g\n", k % 4, k / 4,
                   found, slope);
            exit(1);
        }
    }
}

static void exchange_model(fmu *f, portmet_scene *fine, long steps) {
    SUNContext context;
    size_t nz;
    const double *expected = portmet_scene_array(fine, PORTMET_STATE, &nz);
    const double end = (double)steps * portmet_scene_dt(fine);
    double t = 0, scale = 0;
    start(f, f->me);
    require(CALL(f, plain, "fmi3EnterContinuousTimeMode")(f->me), "continuous time");
    SUNContext_Create(NULL, &context);
    N_Vector z = N_VNew_Serial((sunindextype)f->n, context), zdot = N_VClone(z);
    SUNMatrix matrix = SUNDenseMatrix((sunindextype)f->n, (sunindextype)f->n, context);
    require(CALL(f, numbers, "fmi3GetContinuousStates")(f->me, N_VGetArrayPointer(z), f->n),
            "the states");
    check_jacobian(f, z, zdot, matrix);
    check_ledger(f, fine, z, zdot);
    void *cvode = CVodeCreate(CV_BDF, context);
    SUNLinearSolver solver = SUNLinSol_Dense(z, matrix, context);
    if (CVodeInit(cvode, rate, 0, z) != 0 || CVodeSetUserData(cvode, f) != 0 ||
        CVodeSStolerances(cvode, TOLERANCE, SMALL) != 0 ||
        CVodeSetLinearSolver(cvode, solver, matrix) != 0 || CVodeSetJacFn(cvode, jacobian) != 0 ||
        CVodeSetMaxNumSteps(cvode, 1000000) != 0 || CVode(cvode, end, z, &t, CV_NORMAL) < 0) {
        stop("CVODE");
    }
    // Inputs hold their first values, as in the FMU.
    size_t ninput;
    double *held = portmet_scene_inputs(fine, &ninput);
    for (size_t i = 0; i < ninput; ++i) {
        const fmi3ValueReference r = (fmi3ValueReference)(1 + 2 * f->n + i);
        require(CALL(f, values, "fmi3GetFloat64")(f->me, &r, 1, &held[i], 1), "an input");
    }
    if (portmet_scene_step(fine, steps) != PORTMET_OK) {
        stop(portmet_error());
    }
    for (size_t i = 0; i < nz; ++i) {
        scale = fmax(scale, fabs(expected[i]));
    }
    for (size_t i = 0; i < nz; ++i) {
        const double error = fabs(N_VGetArrayPointer(z)[i] - expected[i]) / scale;
        if (!(error <= AGREEMENT)) {
            printf("FAILED: Model Exchange, state %zu: %.12g, expected %.12g\n", i,
                   N_VGetArrayPointer(z)[i], expected[i]);
            exit(1);
        }
    }
    SUNLinSolFree(solver);
    CVodeFree(&cvode);
    SUNMatDestroy(matrix);
    N_VDestroy(zdot);
    N_VDestroy(z);
    SUNContext_Free(&context);
}

int main(int argc, char **argv) {
    portmet_scene *scene = NULL, *fine = NULL;
    fmu f = {0};
    if (argc != 6) {
        stop("expected LIBRARY TOKEN SCENE FINE STEPS");
    }
    if (portmet_scene_open(&scene, argv[3], NULL) != 0 ||
        portmet_scene_open(&fine, argv[4], NULL) != 0) {
        stop(portmet_error());
    }
    const long steps = atol(argv[5]);
    open_fmu(&f, argv[1], argv[2]);
    co_simulate(&f, scene, steps);
    exchange_model(&f, fine, steps < 10 ? steps : 10);
    ((void (*)(fmi3Instance))(uintptr_t)find(&f, "fmi3FreeInstance"))(f.me);
    ((void (*)(fmi3Instance))(uintptr_t)find(&f, "fmi3FreeInstance"))(f.cs);
    dlclose(f.library);
    portmet_scene_close(scene);
    portmet_scene_close(fine);
    return 0;
}
