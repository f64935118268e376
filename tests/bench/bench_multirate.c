// Compares multirate integrators, in which each subsystem takes substeps of its own, with
// single-rate ones, in which all subsystems take the steps of the fastest. The scenes are a
// vibration of 40 rad/s that warms a slow bath by friction, and the double pendulum, in which no
// subsystem is faster than the other. Errors are relative to a solution converged to rounding, in
// the norm of the whole state after all steps. Times are CPU times in one process.
//   run_bench_multirate CSV CONFIGS
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/linalg.h"
#include "bench.h"
#include "scene/columns.h"
#include "scene/integrator.h"
#include "sim/monolithic.h"
#include "store/dataset.h"

#define EXACT_SUBSTEPS 2048
#define STEPS 20
#define MAX_STATE 16
#define TIMING 0.2 // s, CPU time over which a step is measured

static const char vibration[] =
    "scene: vibration\n"
    "time: {dt: 1.0, steps: 20, integrator: rk4}\n"
    "models:\n"
    "  body:\n"
    "    constants: {m: 0.5, k: 800, mu: 0.05, c: 5, Tr: 300}\n"
    "    energy: [\"|p|^2/(2*m) + k/2*|q|^2\", \"c*Tr*exp(s/c)\"]\n"
    "    entropy: s\n"
    "    reversible: {given: [[q, p, 1]]}\n"
    "    irreversible: {given: [[p, s, \"mu*dE.s\"]]}\n"
    "  bath: {energy: \"1000*exp(s/4)\", entropy: s}\n"
    "  wire: {law: bracket, irreversible: {given: [[a.s, b.s, \"0.7*b.dE.s/a.dE.s\"]]}}\n"
    "subsystems:\n"
    "  body: {model: body, initial: {q: [0.3, -0.1], p: [5, 2], s: 0.1}, state:\n"
    "    {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n"
    "  bath: {model: bath, initial: {s: -0.2}, state: {s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  wire: {law: bracket, between: [body, bath], model: wire, expose: {body: s, bath: s}}\n";

typedef struct bench {
    FILE *csv;
    pm_scene *scene;
    pm_system *system;
    double start[MAX_STATE], exact[MAX_STATE];
} bench;

typedef struct setting {
    const char *integrator;
    int substeps, own[2]; // exchange steps per step; steps per interval of both parts
} setting;

// Where the steps lead, how far the energy strays, and CPU time per simulated second.
static pm_status roll_out(const bench *b, setting how, double *z, double *drift, double *seconds) {
    pm_monolithic *assembly = NULL;
    pm_status status = PM_OK;
    long steps = 0;
    b->scene->integrator = pm_integrator_find(how.integrator);
    b->scene->substeps = how.substeps;
    for (int i = 0; i < 2; ++i) {
        b->scene->subsystem[i].substeps = how.own[i];
    }
    PM_TRY(pm_monolithic_open(&assembly, b->system));
    const pm_sample *sample = pm_monolithic_sample(assembly);
    *drift = 0;
    double elapsed = 0, first = 0;
    for (const double start = bench_clock(); steps < STEPS || elapsed < TIMING; ++steps) {
        if (steps % STEPS == 0) {
            pm_monolithic_set_state(assembly, b->start);
            sample = pm_monolithic_sample(assembly);
            first = sample->energy[0] + sample->energy[1];
        }
        PM_TRY_DONE(pm_monolithic_step(assembly));
        sample = pm_monolithic_sample(assembly);
        *drift = fmax(*drift, fabs(sample->energy[0] + sample->energy[1] - first));
        if (steps == STEPS - 1) {
            memcpy(z, sample->z, (size_t)b->scene->nz * sizeof *z);
        }
        elapsed = bench_clock() - start;
    }
    *seconds = elapsed / (double)steps / b->scene->dt;
done:
    pm_monolithic_close(assembly);
    return status;
}

static pm_status measure(const bench *b, setting how) {
    double z[MAX_STATE], drift, seconds, difference = 0, size = 0;
    const pm_integrator *rk = pm_integrator_find(how.integrator);
    PM_TRY(roll_out(b, how, z, &drift, &seconds));
    for (int i = 0; i < b->scene->nz; ++i) {
        difference += (z[i] - b->exact[i]) * (z[i] - b->exact[i]);
        size += b->exact[i] * b->exact[i];
    }
    const double error = sqrt(difference / size);
    const double exchanges = how.substeps * rk->nstage / b->scene->dt;
    printf("%-16s %-20s %8d %5d %5d %12.0f %12.3e %10.1e %10.1e\n", b->scene->name, how.integrator,
           how.substeps, how.own[0], how.own[1], exchanges, seconds, error, drift);
    fprintf(b->csv, "%s,%s,%d,%d,%d,%g,%.4g,%.4g,%.4g\n", b->scene->name, how.integrator,
            how.substeps, how.own[0], how.own[1], exchanges, seconds, error, drift);
    fflush(stdout);
    return PM_OK;
}

static pm_status measure_all(bench *b, int count, const setting *settings) {
    double ignored[2];
    PM_TRY(
        roll_out(b, (setting){"rk6", EXACT_SUBSTEPS, {1, 1}}, b->exact, &ignored[0], &ignored[1]));
    for (int i = 0; i < count; ++i) {
        PM_TRY(measure(b, settings[i]));
    }
    return PM_OK;
}

static pm_status measure_vibration(bench *b) {
    static const setting settings[] = {
        {"rk4", 64, {1, 1}},         {"rk4", 256, {1, 1}},
        {"rk4", 1024, {1, 1}},       {"rk4_balanced", 1024, {1, 1}},
        {"multirate3", 1, {64, 1}},  {"multirate3", 1, {256, 1}},
        {"multirate3", 4, {16, 1}},  {"multirate3", 4, {64, 1}},
        {"multirate3", 4, {256, 1}}, {"multirate3_balanced", 4, {64, 1}},
        {"multirate3", 16, {16, 1}}, {"multirate3", 16, {64, 1}}};
    PM_TRY(pm_scene_parse(&b->scene, vibration, "vibration.yaml"));
    PM_TRY(pm_system_load(&b->system, b->scene, NULL));
    for (int i = 0; i < b->scene->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &b->scene->subsystem[i];
        memcpy(b->start + s->first, s->initial, (size_t)s->layout.nz * sizeof *b->start);
    }
    return measure_all(b, sizeof settings / sizeof *settings, settings);
}

static pm_status measure_pendulum(bench *b, const char *configs) {
    static const setting settings[] = {
        {"rk4", 2, {1, 1}},        {"rk4", 4, {1, 1}},         {"rk4", 8, {1, 1}},
        {"rk4", 16, {1, 1}},       {"multirate3", 2, {1, 1}},  {"multirate3", 4, {1, 1}},
        {"multirate3", 8, {1, 1}}, {"multirate3", 16, {1, 1}}, {"multirate3", 8, {4, 4}}};
    char path[4096];
    pm_dataset *reference = NULL;
    pm_columns columns;
    pm_status status;
    snprintf(path, sizeof path, "%s/double_pendulum.yaml", configs);
    PM_TRY(pm_scene_load(&b->scene, path));
    PM_TRY(pm_system_load(&b->system, b->scene, NULL));
    PM_TRY(pm_dataset_load(&reference, b->scene->reference));
    PM_TRY_DONE(pm_columns_bind(&columns, b->scene, reference, &reference->arena));
    pm_columns_to_state(&columns, pm_dataset_state(reference, 0, 0), b->start);
    status = measure_all(b, sizeof settings / sizeof *settings, settings);
done:
    pm_dataset_free(reference);
    return status;
}

static void close_bench(bench *b) {
    pm_system_free(b->system);
    pm_scene_free(b->scene);
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: run_bench_multirate CSV CONFIGS\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    bench fast = {.csv = fopen(argv[1], "w")}, slow = {.csv = fast.csv};
    if (fast.csv == NULL) {
        fprintf(stderr, "bench_multirate: %s cannot be written\n", argv[1]);
        return PM_EFILE;
    }
    printf("%-16s %-20s %8s %11s %12s %12s %10s %10s\n", "", "", "substeps", "own", "exchanges/s",
           "CPU s per s", "error", "drift, J");
    fprintf(fast.csv, "scene,method,substeps,own_a,own_b,exchanges,seconds,error,drift\n");
    pm_status status = measure_vibration(&fast);
    if (status == PM_OK) {
        status = measure_pendulum(&slow, argv[2]);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_multirate: %s\n", pm_error());
    }
    close_bench(&fast);
    close_bench(&slow);
    fclose(fast.csv);
    return (int)status;
}
