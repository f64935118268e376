// Work-precision study on a grid of many known parts: a membrane of masses that conduct heat
// (membrane.h), run by portmet's integrators on a scene of formulas, and by CVODE on the same
// equations written out by hand. Errors are relative to a converged solution by CVODE, at the end
// of the run, for the worst of momenta, elongations and entropies.
//   run_bench_grid CSV [SIDE [slow|fast]]
// Rows: conduction, method, substeps or tolerance, CPU time of the run, error, change of the total
// energy, largest relative residual of the energy in a port, largest fall of the entropy over a
// step, evaluations of all rates.
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "bench.h"
#include "membrane.h"
#include "scene/integrator.h"
#include "sim/ledger.h"
#include "sim/monolithic.h"

#define STEPS 10
#define DT 0.5         // s
#define LONGEST 15.0   // s of CPU time; a longer run is the last one of its method
#define SMALL_SIDE 30  // largest grid for a tolerance and discrete_gradient, which take long
#define SMALLEST 1e-11 // error below which a method takes no more, smaller steps

typedef struct bench {
    FILE *csv;
    const char *name; // of the system
    pm_arena arena;
    membrane membrane;
    pm_ode ode;
    long rates;
    pm_scene *scene;
    pm_system *system;
    double *z;     // [STEPS + 1][nz]
    double *exact; // [nz] at the end

} bench;

typedef struct row {
    const char *method;
    double parameter, seconds, error, drift, residual, fall, rates;
} row;

static void print_row(const bench *b, const row *r) {
    printf("%-8s %-22s %8g %10.3f %10.1e %10.1e %10.1e %10.1e %8g\n", b->name, r->method,
           r->parameter, r->seconds, r->error, r->drift, r->residual, r->fall, r->rates);
    fprintf(b->csv, "%s,%s,%g,%.4g,%.3g,%.3g,%.3g,%.3g,%g\n", b->name, r->method, r->parameter,
            r->seconds, r->error, r->drift, r->residual, r->fall, r->rates);
    fflush(stdout);
    fflush(b->csv);
}

// Returns the error of z [nz], which is infinite if a component is not finite.
static double error_of(const bench *b, const double *z) {
    static const int begin[] = {MEMBRANE_P, MEMBRANE_X, MEMBRANE_S, MEMBRANE_NZ};
    double worst = 0;
    for (int g = 0; g < 3; ++g) {
        double error = 0, norm = 0;
        for (int c = 0; c < b->ode.nz; c += MEMBRANE_NZ) {
            for (int i = c + begin[g]; i < c + begin[g + 1]; ++i) {
                error += (z[i] - b->exact[i]) * (z[i] - b->exact[i]);
                norm += b->exact[i] * b->exact[i];
            }
        }
        worst = isfinite(error) ? fmax(worst, sqrt(error / norm)) : INFINITY;
    }
    return worst;
}

// --- CVODE ---

// Solves into b->z from the start, and fills all of the row but its method and its error.
static pm_status solve(bench *b, pm_ode_family family, double tolerance, row *r) {
    const pm_ode_method method = {family, tolerance, 0.01 * tolerance};
    membrane_start(&b->membrane, b->z);
    b->rates = 0;
    const double before = bench_clock();
    PM_TRY(pm_ode_solve(&b->ode, method, STEPS + 1, DT, b->z));
    r->seconds = bench_clock() - before;
    r->parameter = tolerance;
    r->rates = (double)b->rates;
    r->residual = NAN;
    r->drift = r->fall = 0;
    const double energy = membrane_energy(&b->membrane, b->z);
    double entropy = membrane_entropy(&b->membrane, b->z);
    for (int i = 1; i <= STEPS; ++i) {
        const double *z = b->z + (ptrdiff_t)i * b->ode.nz;
        const double now = membrane_entropy(&b->membrane, z);
        r->drift = fmax(r->drift, fabs(membrane_energy(&b->membrane, z) - energy));
        r->fall = fmax(r->fall, entropy - now);
        entropy = now;
    }
    return PM_OK;
}

static pm_status measure_cvode(bench *b, pm_ode_family family, const char *name) {
    row r = {.method = name};
    for (double tolerance = 1e-3; tolerance > 5e-12; tolerance /= 100) {
        PM_TRY(solve(b, family, tolerance, &r));
        r.error = error_of(b, b->z + (ptrdiff_t)STEPS * b->ode.nz);
        print_row(b, &r);
        if (r.seconds > LONGEST) {
            break;
        }
    }
    return PM_OK;
}

static pm_status solve_exactly(bench *b) {
    row r;
    PM_TRY(solve(b, PM_ODE_ADAMS, 1e-12, &r));
    memcpy(b->exact, b->z + (ptrdiff_t)STEPS * b->ode.nz, (size_t)b->ode.nz * sizeof *b->z);
    printf("%s: reference by CVODE Adams with tolerance 1e-12, %.1f s of CPU time\n", b->name,
           r.seconds);
    return PM_OK;
}

// --- portmet ---

// The integrator is another one in each measurement. An implicit one lets the reader look for the
// subsystems that are farthest apart.
static pm_status parse(bench *b, int side) {
    static const char format[] =
        "scene: membrane\n"
        "time: {dt: %g, steps: %d, integrator: discrete_gradient}\n"
        "models:\n"
        "  cell:\n"
        "    constants: {m: %g, k: %g, n: %g, b: %g, c: %g, mu: %g, Tr: %g}\n"
        "    energy:\n"
        "      - \"p^2/(2*m)\"\n"
        "      - \"k/2*(x^2 + y^2) + n/4*(x^4 + y^4) + b*Tr*(x + y)\"\n"
        "      - \"c*Tr*(exp((s - b*(x + y))/c) - 1)\"\n"
        "    entropy: s\n"
        "    reversible: {given: [[x, p, 1.0], [y, p, 1.0]]}\n"
        "    irreversible: {given: [[p, s, \"mu*dE.s\"]]}\n"
        "  across: {law: bracket, constants: {K: %g}, reversible: {given: [[a.p, b.x, 1.0]]},\n"
        "    irreversible: {given: [[a.s, b.s, \"K*b.dE.s/a.dE.s\"]]}}\n"
        "  along: {law: bracket, constants: {K: %g}, reversible: {given: [[a.p, b.y, 1.0]]},\n"
        "    irreversible: {given: [[a.s, b.s, \"K*b.dE.s/a.dE.s\"]]}}\n"
        "subsystems:\n"
        "  \"cell[0:%d][0:%d]\":\n"
        "    model: cell\n"
        "    state: {p: {unit: kg m/s, size: 1}, x: {unit: m, size: 1}, y: {unit: m, size: 1},\n"
        "            s: {unit: J/K, size: 1}}\n"
        "ports:\n"
        "  \"across[0:%d][0:%d]\": {law: bracket, model: across,\n"
        "    between: [\"cell[i][j]\", \"cell[i+1][j]\"],\n"
        "    expose: {\"cell[i][j]\": [p, s], \"cell[i+1][j]\": [x, s]}}\n"
        "  \"along[0:%d][0:%d]\": {law: bracket, model: along,\n"
        "    between: [\"cell[i][j]\", \"cell[i][j+1]\"],\n"
        "    expose: {\"cell[i][j]\": [p, s], \"cell[i][j+1]\": [y, s]}}\n";
    const membrane *w = &b->membrane;
    char text[4096];
    snprintf(text, sizeof text, format, DT, STEPS, w->m, w->k, w->n, w->b, w->c, w->mu, w->Tr, w->K,
             w->K, side, side, side - 1, side, side, side - 1);
    return pm_scene_parse(&b->scene, text, "membrane.yaml");
}

// Steps to the end. Only the steps count as time, not the samples and the ledger.
static pm_status run(bench *b, pm_monolithic *m, row *r) {
    pm_ledger ledger;
    pm_ledger_init(&ledger, b->system);
    membrane_start(&b->membrane, b->z);
    pm_monolithic_set_state(m, b->z);
    PM_TRY(pm_ledger_add_sample(&ledger, (pm_sample *)pm_monolithic_sample(m)));
    r->seconds = r->rates = 0;
    for (int i = 0; i < STEPS; ++i) {
        r->rates += pm_monolithic_substeps(m) * b->scene->physics.integrator->nstage;
        const double before = bench_clock();
        PM_TRY(pm_monolithic_step(m));
        r->seconds += bench_clock() - before;
        PM_TRY(pm_ledger_add_sample(&ledger, (pm_sample *)pm_monolithic_sample(m)));
    }
    r->error = error_of(b, pm_monolithic_sample(m)->z);
    r->drift = ledger.energy_drift;
    r->residual = ledger.worst_energy;
    r->fall = ledger.worst_entropy_fall;
    return PM_OK;
}

// Measures a run. Returns true if a finer one is worth while.
static bool measure_run(bench *b, const char *method, row *r) {
    pm_monolithic *m = NULL;
    r->method = method;
    pm_status status = pm_monolithic_open(&m, b->system);
    status = status == PM_OK ? run(b, m, r) : status;
    pm_monolithic_close(m);
    if (status == PM_OK) {
        print_row(b, r);
    } else {
        printf("%-8s %-22s %8g fails: %.60s\n", b->name, method, r->parameter, pm_error());
        r->error = INFINITY;
    }
    return r->seconds < LONGEST && r->error > SMALLEST;
}

static void measure_fixed(bench *b, const char *method, int most) {
    row r = {.seconds = 0};
    b->scene->physics.integrator = pm_integrator_find(method);
    b->scene->physics.tolerance = 0;
    for (int substeps = 1, go_on = 1; go_on && substeps <= most; substeps *= 2) {
        b->scene->physics.substeps = substeps;
        r.parameter = substeps;
        go_on = measure_run(b, method, &r);
    }
}

static void measure_adaptive(bench *b, const char *method, int substeps) {
    row r = {.seconds = 0};
    char name[64];
    snprintf(name, sizeof name, "%s_adaptive", method);
    b->scene->physics.integrator = pm_integrator_find(method);
    b->scene->physics.substeps = substeps;
    bool go_on = true;
    for (double tolerance = 1e-2; go_on && tolerance > 5e-8; tolerance /= 10) {
        b->scene->physics.tolerance = r.parameter = tolerance;
        go_on = measure_run(b, name, &r);
    }
    b->scene->physics.tolerance = 0;
}

// --- systems ---

static pm_status open_system(bench *b, int side) {
    const size_t cells = (size_t)side * (size_t)side, nz = MEMBRANE_NZ * cells;
    b->membrane = (membrane){.side = side,
                             .m = 1,
                             .k = 1,
                             .n = 0.1,
                             .b = 0.05,
                             .c = 0.5,
                             .mu = 0.05,
                             .Tr = 300,
                             .K = b->membrane.K,
                             .work = pm_arena_array(&b->arena, 3 * cells, sizeof(double)),
                             .rates = &b->rates};
    b->ode = (pm_ode){.nz = (int)nz,
                      .rate = membrane_rate,
                      .data = &b->membrane,
                      .pattern = membrane_pattern(&b->membrane, &b->arena)};
    b->z = pm_arena_array(&b->arena, (STEPS + 1) * nz, sizeof(double));
    b->exact = pm_arena_array(&b->arena, nz, sizeof(double));
    if (b->membrane.work == NULL || b->ode.pattern == NULL || b->z == NULL || b->exact == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a benchmark");
    }
    const double before = bench_clock();
    PM_TRY(parse(b, side));
    PM_TRY(pm_system_load(&b->system, b->scene, NULL));
    printf("%s: %d cells, K = %g W/K; the scene was read and built in %.2f s of CPU time\n",
           b->name, side * side, b->membrane.K, bench_clock() - before);
    return PM_OK;
}

// `stable`: substeps from which on rk4 is stable.
static pm_status measure_system(FILE *csv, const char *name, double K, int side, int stable) {
    bench b = {.csv = csv, .name = name, .membrane = {.K = K}};
    pm_status status;
    PM_TRY_DONE(open_system(&b, side));
    PM_TRY_DONE(solve_exactly(&b));
    PM_TRY_DONE(measure_cvode(&b, PM_ODE_ADAMS, "CVODE Adams"));
    PM_TRY_DONE(measure_cvode(&b, PM_ODE_BDF, "CVODE BDF KLU"));
    static const char *const methods[] = {"heun", "rk4", "rk6", "rk4_balanced", "rk6_balanced"};
    for (size_t i = 0; i < sizeof methods / sizeof *methods; ++i) {
        measure_fixed(&b, methods[i], stable > 1 ? 2 * stable : 16);
    }
    if (side <= SMALL_SIDE) {
        measure_adaptive(&b, "rk4", stable);
        measure_fixed(&b, "discrete_gradient", 4);
    }
done:
    pm_system_free(b.system);
    pm_scene_free(b.scene);
    pm_arena_free(&b.arena);
    return status;
}

int main(int argc, char **argv) {
    const int side = argc >= 3 ? atoi(argv[2]) : 100;
    const char *only = argc == 4 ? argv[3] : NULL;
    if (argc < 2 || argc > 4 || side < 4 || side > 1000) {
        fprintf(stderr, "usage: run_bench_grid CSV [SIDE [slow|fast]]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    FILE *csv = fopen(argv[1], "w");
    if (csv == NULL) {
        fprintf(stderr, "bench_grid: %s: %s\n", argv[1], strerror(errno));
        return PM_EFILE;
    }
    fprintf(csv, "system,method,parameter,seconds,error,drift,residual,fall,rates\n");
    printf("%-8s %-22s %8s %10s %10s %10s %10s %10s %8s\n", "", "", "", "CPU, s", "error",
           "drift, J", "port", "fall, J/K", "rates");
    pm_status status = PM_OK;
    if (only == NULL || strcmp(only, "slow") == 0) {
        status = measure_system(csv, "slow", 0.05, side, 1);
    }
    if (status == PM_OK && (only == NULL || strcmp(only, "fast") == 0)) {
        status = measure_system(csv, "fast", 10, side, 32);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_grid: %s\n", pm_error());
    }
    fclose(csv);
    return (int)status;
}
