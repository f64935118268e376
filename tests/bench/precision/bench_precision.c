// Work-precision study: measures run time and error of every integrator while its step is halved
// again and again, on scenes with their shipped weights. Errors are relative to a solution of the
// learned equations converged to rounding (the error of the integrator alone) and to the true
// trajectories (the total error). If nothing is learned both are the same. The simulator that made
// the truth is measured at several tolerances for comparison.
//   run_bench_precision CSV CONFIGS SCENE ...
// Rows: scene, method, substeps (or, for rk4_adaptive and the like, the tolerance), exchanges per
// second, CPU time per simulated second, errors, drift of the energy, largest fall of the entropy,
// mean of the first error. Errors are relative L2 errors over a trajectory for the worst group of
// variables, and medians over trajectories of a separate seed.
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "bench.h"
#include "evaluate/evaluate.h"
#include "scene/integrator.h"
#include "sim/monolithic.h"
#include "truth/truth.h"

#define SEED 20231105
#define TRAJECTORIES 12
// Of the exact solution; half as many tell how exact it is.
#define EXACT_SUBSTEPS 128
// Exchanges per step; the longest run of each method has as many.
#define MOST_ROUNDS 512
#define MAX_GROUPS 16
#define MAX_STATE 64
#define TIMING 0.05 // s, CPU time over which a step is measured

typedef struct bench {
    FILE *csv;
    pm_truth *truth;
    pm_scene *scene;
    pm_system *system;
    pm_dataset *physics;
    double tolerance; // of adaptive substeps, or 0
    int least;        // substeps of rk4 that are stable; 0: not known yet
    pm_columns columns;
    pm_evaluation *solved;   // of the learned equations; NULL: nothing is learned
    const pm_dataset *exact; // of the scene's equations
} bench;

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a benchmark");
}

// --- rows ---

typedef struct row {
    const char *method;
    double substeps, exchanges; // exchanges per simulated second
    double seconds;             // of CPU time per simulated second
    double own, all;            // errors against the learned equations and physics
    double drift, fall;         // J, J/K
    double mean;                // of own
} row;

static void print_row(const bench *b, const row *r) {
    printf("%-22s %-21s %8g %10.0f %12.3e %10.1e %10.1e %10.1e %10.1e %10.1e\n", b->scene->name,
           r->method, r->substeps, r->exchanges, r->seconds, r->own, r->mean, r->all, r->drift,
           r->fall);
    fprintf(b->csv, "%s,%s,%g,%g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g\n", b->scene->name, r->method,
            r->substeps, r->exchanges, r->seconds, r->own, r->all, r->drift, r->fall, r->mean);
    fflush(stdout);
}

static void print_header(FILE *csv) {
    printf("%-22s %-21s %8s %10s %12s %10s %10s %10s %10s %10s\n", "", "", "substeps",
           "exchanges/s", "CPU s per s", "own error", "its mean", "error", "drift, J", "fall, J/K");
    fprintf(csv, "scene,method,substeps,exchanges,seconds,own,all,drift,fall,mean\n");
}

// --- errors ---

// Of the group that is worst.
static double error_of(const pm_columns *columns, const pm_dataset *predicted,
                       const pm_dataset *truth, int trajectory) {
    double error[MAX_GROUPS], worst = 0;
    pm_score(columns, truth->ntime, truth->ncolumn, pm_dataset_state(predicted, trajectory, 0),
             pm_dataset_state(truth, trajectory, 0), error, NULL);
    for (int i = 0; i < columns->ngroup; ++i) {
        worst = isnan(error[i]) ? INFINITY : fmax(worst, error[i]);
    }
    return worst;
}

// Over all trajectories; infinite for rollouts that did not go all the way.
static pm_box box_of_errors(const pm_evaluation *e, const pm_dataset *truth) {
    double error[TRAJECTORIES];
    for (int i = 0; i < TRAJECTORIES; ++i) {
        const bool whole = e->rollout[i].reached == truth->ntime;
        error[i] = whole ? error_of(&e->columns, e->predicted, truth, i) : INFINITY;
    }
    return pm_box_of(TRAJECTORIES, error);
}

// --- the learned equations ---

static pm_status roll_out(const bench *b, const char *method, int substeps, pm_evaluation **e) {
    const pm_evaluate_how how = {.threads = 1};
    b->scene->physics.integrator = pm_integrator_find(method);
    b->scene->physics.substeps = substeps;
    b->scene->physics.tolerance = b->tolerance;
    return pm_evaluate(e, b->system, b->physics, 0, TRAJECTORIES, &how);
}

static bool is_learned(const bench *b) {
    size_t numbers = 0;
    for (int i = 0; i < pm_system_components(b->system); ++i) {
        numbers += pm_params_trained(pm_system_params(b->system, i));
    }
    return numbers > 0;
}

static pm_status solve_learned(bench *b) {
    pm_evaluation *half = NULL;
    PM_TRY(roll_out(b, "rk6_balanced", EXACT_SUBSTEPS / 2, &half));
    const pm_status status = roll_out(b, "rk6_balanced", EXACT_SUBSTEPS, &b->solved);
    if (status == PM_OK) {
        b->exact = b->solved->predicted;
        printf("%s: the learned equations are solved to %.1e (median)\n", b->scene->name,
               box_of_errors(half, b->exact).median);
    }
    pm_evaluation_free(half);
    return status;
}

static pm_status solve_exactly(bench *b) {
    PM_TRY(pm_columns_bind(&b->columns, b->scene, b->physics, &b->physics->arena));
    b->exact = b->physics;
    return is_learned(b) ? solve_learned(b) : PM_OK;
}

// CPU time and substeps per simulated second, along one trajectory after another: all of them,
// where these differ in it.
static pm_status time_steps(const bench *b, row *r) {
    pm_monolithic *assembly = NULL;
    PM_TRY(pm_monolithic_open(&assembly, b->system));
    const long length = b->physics->ntime - 1, least = b->tolerance > 0 ? TRAJECTORIES * length : 0;
    long steps = 0, substeps = 0;
    double elapsed = 0, z[MAX_STATE];
    for (const double start = bench_clock(); elapsed < TIMING || steps < least; ++steps) {
        if (steps % length == 0) {
            const int trajectory = (int)(steps / length % TRAJECTORIES);
            pm_columns_to_state(&b->columns, pm_dataset_state(b->physics, trajectory, 0), z);
            pm_monolithic_set_state(assembly, z);
        }
        substeps += pm_monolithic_substeps(assembly);
        // A method that is not stable here costs what it costs.
        (void)pm_monolithic_step(assembly);
        elapsed = bench_clock() - start;
    }
    pm_monolithic_close(assembly);
    r->seconds = elapsed / (double)steps / b->scene->physics.dt;
    r->exchanges = r->exchanges * (double)substeps / (double)steps;
    return PM_OK;
}

static pm_status measure_method(bench *b, const pm_integrator *rk, int substeps) {
    pm_evaluation *e = NULL;
    char method[64];
    snprintf(method, sizeof method, "%s%s", rk->name, b->tolerance > 0 ? "_adaptive" : "");
    PM_TRY(roll_out(b, rk->name, substeps, &e));
    const pm_box own = box_of_errors(e, b->exact);
    row r = {.method = method,
             .substeps = b->tolerance > 0 ? b->tolerance : substeps,
             .exchanges = rk->nstage / b->scene->physics.dt,
             .own = own.median,
             .mean = own.mean,
             .all = box_of_errors(e, b->physics).median};
    for (int i = 0; i < TRAJECTORIES; ++i) {
        const pm_rollout *rollout = &e->rollout[i];
        const bool whole = rollout->reached == b->physics->ntime;
        r.drift = fmax(r.drift, whole ? rollout->ledger.energy_drift : INFINITY);
        r.fall = fmax(r.fall, rollout->ledger.worst_entropy_fall);
    }
    pm_evaluation_free(e);
    b->least = b->least == 0 && strcmp(rk->name, "rk4") == 0 && own.mean < 1 ? substeps : b->least;
    PM_TRY(time_steps(b, &r));
    print_row(b, &r);
    return PM_OK;
}

static pm_status measure_adaptive(bench *b) {
    static const char *const method[] = {"rk4", "rk4_balanced"};
    for (int i = 0; i < 2; ++i) {
        for (b->tolerance = 1e-2; b->tolerance > 1e-7; b->tolerance /= 10) {
            PM_TRY(measure_method(b, pm_integrator_find(method[i]), b->least));
        }
    }
    b->tolerance = 0;
    return PM_OK;
}

static pm_status measure_methods(bench *b) {
    char names[256];
    snprintf(names, sizeof names, "%s", pm_integrator_names());
    for (char *rest = names, *name; (name = strtok_r(rest, ", ", &rest)) != NULL;) {
        const pm_integrator *rk = pm_integrator_find(name);
        for (int substeps = 1; substeps * rk->nstage <= MOST_ROUNDS; substeps *= 2) {
            PM_TRY(measure_method(b, rk, substeps));
        }
    }
    return PM_OK;
}

// --- physics ---

// Keeps the columns of a solution [ntime][nz].
static void keep(const pm_truth *truth, const double *z, pm_dataset *dataset, int trajectory) {
    for (int j = 0; j < truth->ntime; ++j) {
        memcpy(pm_dataset_state(dataset, trajectory, j), z + (ptrdiff_t)j * truth->model.ode.nz,
               (size_t)dataset->ncolumn * sizeof *z);
    }
}

static pm_status simulate(const pm_truth *truth, pm_dataset *dataset) {
    const size_t size = (size_t)truth->ntime * (size_t)truth->model.ode.nz;
    double *z = calloc(2 * size, sizeof *z);
    pm_status status = z == NULL ? no_memory() : PM_OK;
    for (int i = 0; i < TRAJECTORIES && status == PM_OK; ++i) {
        status = pm_truth_run(truth, i, z, z + size);
        if (status == PM_OK) {
            keep(truth, z, dataset, i);
        }
    }
    free(z);
    return status;
}

// The simulator at one tolerance; z [ntime][nz] is work space.
static pm_status measure_simulator(const bench *b, double tolerance, pm_dataset *solved,
                                   double *z) {
    const pm_ode_method method = {b->truth->family, tolerance, tolerance};
    const int ntime = b->truth->ntime;
    double error[TRAJECTORIES], seconds = 0;
    for (int i = 0; i < TRAJECTORIES; ++i) {
        memcpy(z, pm_dataset_state(b->physics, i, 0), (size_t)b->physics->ncolumn * sizeof *z);
        const double before = bench_clock();
        PM_TRY(pm_ode_solve(&b->truth->model.ode, method, ntime, b->truth->dt, z));
        seconds += (bench_clock() - before) / ((ntime - 1) * b->truth->dt) / TRAJECTORIES;
        keep(b->truth, z, solved, i);
        error[i] = error_of(&b->columns, solved, b->physics, i);
    }
    const row r = {.method = b->truth->family == PM_ODE_ADAMS ? "CVODE Adams" : "CVODE BDF",
                   .substeps = tolerance,
                   .seconds = seconds,
                   .own = NAN,
                   .mean = NAN,
                   .all = pm_box_of(TRAJECTORIES, error).median};
    print_row(b, &r);
    return PM_OK;
}

static pm_status measure_simulators(const bench *b) {
    pm_dataset *solved = NULL;
    double *z = calloc((size_t)b->truth->ntime * (size_t)b->truth->model.ode.nz, sizeof *z);
    pm_status status = z == NULL ? no_memory() : PM_OK;
    PM_TRY_DONE(status);
    PM_TRY_DONE(pm_dataset_new(&solved, TRAJECTORIES, b->physics->ntime, b->physics->ncolumn,
                               b->physics->dt, b->physics->column));
    for (int digits = 3; digits <= 12; ++digits) {
        PM_TRY_DONE(measure_simulator(b, pow(10, -digits), solved, z));
    }
done:
    pm_dataset_free(solved);
    free(z);
    return status;
}

// --- scenes ---

static pm_status open_scene(bench *b, const char *configs, const char *name) {
    char path[4096];
    snprintf(path, sizeof path, "%s/truth/%s.yaml", configs, name);
    PM_TRY(pm_truth_load(&b->truth, path, NULL));
    b->truth->seed = SEED;
    PM_TRY(pm_dataset_new(&b->physics, TRAJECTORIES, b->truth->ntime, b->truth->model.ncolumn,
                          b->truth->dt, b->truth->model.column));
    PM_TRY(simulate(b->truth, b->physics));
    snprintf(path, sizeof path, "%s/%s.yaml", configs, name);
    PM_TRY(pm_scene_load(&b->scene, path));
    return pm_system_load(&b->system, b->scene, NULL);
}

static pm_status measure_scene(FILE *csv, const char *configs, const char *name) {
    bench b = {.csv = csv};
    pm_status status;
    PM_TRY_DONE(open_scene(&b, configs, name));
    PM_TRY_DONE(solve_exactly(&b));
    PM_TRY_DONE(measure_methods(&b));
    PM_TRY_DONE(measure_adaptive(&b));
    PM_TRY_DONE(measure_simulators(&b));
done:
    pm_evaluation_free(b.solved);
    pm_system_free(b.system);
    pm_scene_free(b.scene);
    pm_dataset_free(b.physics);
    pm_truth_free(b.truth);
    return status;
}

int main(int argc, char **argv) {
    if (argc < 4) {
        fprintf(stderr, "usage: run_bench_precision CSV CONFIGS SCENE ...\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    FILE *csv = fopen(argv[1], "w");
    if (csv == NULL) {
        fprintf(stderr, "bench_precision: %s: %s\n", argv[1], strerror(errno));
        return PM_EFILE;
    }
    print_header(csv);
    pm_status status = PM_OK;
    for (int i = 3; i < argc && status == PM_OK; ++i) {
        status = measure_scene(csv, argv[2], argv[i]);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_precision: %s\n", pm_error());
    }
    fclose(csv);
    return (int)status;
}
