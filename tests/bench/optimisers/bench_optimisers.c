// The precision of training against its work: the error that each optimiser reaches in a given CPU
// time, for networks of 10^3 to 10^6 weights. The task is a black box of the double pendulum (the
// models of configs/double_pendulum_free.yaml with two hidden layers), trained on steps of 0.3 s
// with heun. The error is that of one step on trajectories that the training does not see: the root
// of the median, and of the mean, of the squared residual, in units of the typical change in a
// step.
//   run_bench_optimisers CSV CONFIGS [BUDGET]    with BUDGET times the CPU time of the report
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "bench.h"
#include "fit/normalization.h"
#include "fit/training.h"
#include "simulate.h"

#define TRAJECTORIES 48
#define TRAINED 40
#define MARKS 3 // errors are measured after the budget, a half, and a quarter of it
#define ADAM_BATCH 64
#define MATRIX_BATCH 1024
#define PRODUCT_BATCH 4000

typedef struct task {
    int width; // of both hidden layers
    double budget;
    bool matrix; // whether the method that forms the matrix takes part
} task;

static const task tasks[] = {{10, 20, true}, {46, 60, false}, {154, 120, false}, {494, 240, false}};

// One optimiser on one task, and what it has reached at each mark.
typedef struct race {
    pm_objective *seen, *unseen;
    double *ignored;                // [size] gradients
    double budget, began, measured; // CPU seconds; `measured` is spent on measuring errors
    int mark;
    FILE *csv;
    const char *optimiser;
} race;

static pm_status write_training(const char *path, const char *configs, int width) {
    FILE *file = fopen(path, "w");
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot be written", path);
    }
    fprintf(file,
            "scene: %s/double_pendulum_free.yaml\n"
            "models:\n"
            "  link: {form: free, rate: {features: [q, p, s], hidden: [%d, %d]}}\n"
            "  joint: {law: exchange, form: free, rate: {features: [own.q, own.p, own.s, other.q, "
            "other.p, other.s], hidden: [%d, %d]}}\n"
            "subsystems: {upper: link, lower: link}\n"
            "ports: {joint: joint}\n"
            "loss: {integrator: heun, substeps: 1, robust: 10}\n"
            "stages: [{optimiser: adam, iterations: 1}]\n",
            configs, width, width, width, width);
    return fclose(file) == 0 ? PM_OK : pm_fail(PM_EFILE, "%s: cannot be written", path);
}

// --- one race ---

static pm_status measure(race *r, const pm_optimisation *o) {
    double median = 0, mean = 0;
    pm_objective_set_weights(r->seen, o->theta); // both objectives share the system
    pm_objective_evaluate(r->unseen, 0, NULL, r->ignored);
    PM_TRY(pm_objective_residuals(r->unseen, &median, &mean));
    const int size = pm_objective_size(r->seen);
    const double seconds = r->budget / (1 << (MARKS - 1 - r->mark));
    printf("  %8d weights  %-16s %7.2f s  %6d iterations   median %8.5f   mean %8.5f\n", size,
           r->optimiser, seconds, o->done, sqrt(median), sqrt(mean));
    fprintf(r->csv, "%d,%s,%g,%d,%.6g,%.6g\n", size, r->optimiser, seconds, o->done, sqrt(median),
            sqrt(mean));
    fflush(stdout);
    return PM_OK;
}

static pm_status report(void *context, const pm_optimisation *o, double loss) {
    (void)loss;
    race *r = context;
    while (bench_clock() - r->began - r->measured >= r->budget / (1 << (MARKS - 1 - r->mark))) {
        const double began = bench_clock();
        PM_TRY(measure(r, o));
        r->measured += bench_clock() - began;
        if (++r->mark == MARKS) {
            return PM_EINTERRUPTED; // ends the race
        }
    }
    return PM_OK;
}

// Estimates how many epochs of adam the budget allows, since its rate falls along that number.
static int count_epochs(race *r) {
    int index[ADAM_BATCH];
    for (int i = 0; i < ADAM_BATCH; ++i) {
        index[i] = i;
    }
    const double began = bench_clock();
    for (int i = 0; i < 8; ++i) {
        pm_objective_evaluate(r->seen, ADAM_BATCH, index, r->ignored);
    }
    const double batches = (double)pm_objective_samples(r->seen) / ADAM_BATCH;
    return (int)(r->budget / ((bench_clock() - began) / 8 * batches)) + 1;
}

static pm_status run(race *r, const double *start) {
    const size_t size = (size_t)pm_objective_size(r->seen);
    double *work = calloc(3 * size, sizeof *work);
    if (work == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory");
    }
    for (size_t i = 0; i < size; ++i) {
        work[i] = start[i];
    }
    pm_objective_set_weights(r->seen, work);
    const bool adam = r->optimiser[0] == 'a';
    pm_optimisation o = {.objective = r->seen,
                         .schedule = {.iterations = adam ? count_epochs(r) : 1000000,
                                      .batch = adam                       ? ADAM_BATCH
                                               : r->optimiser[12] == '\0' ? MATRIX_BATCH
                                                                          : PRODUCT_BATCH,
                                      .first_rate = 3e-3,
                                      .last_rate = 1e-5,
                                      .beta2 = 0.999,
                                      .guarded = true},
                         .seed = 1,
                         .theta = work,
                         .moment = work + size,
                         .report = report,
                         .context = r};
    r->mark = 0;
    r->measured = 0;
    r->began = bench_clock();
    pm_status status = pm_optimiser_find(r->optimiser)->run(&o);
    if (status == PM_OK && r->mark < MARKS) {
        status = measure(r, &o); // adam was faster than estimated
    }
    free(work);
    return status == PM_EINTERRUPTED ? PM_OK : status;
}

// --- one task ---

static void draw_weights(const pm_training *t) {
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        pm_rng rng;
        pm_rng_init(&rng, t->seed, (uint64_t)i);
        pm_params_randomise(pm_system_params(t->system, i), &rng);
    }
}

static pm_status run_all(race *r, bool matrix) {
    static const char *const names[] = {"adam", "gauss_newton_cg", "gauss_newton"};
    const size_t size = (size_t)pm_objective_size(r->seen);
    double *start = calloc(size, sizeof *start);
    r->ignored = calloc(size, sizeof *r->ignored);
    pm_status status =
        start != NULL && r->ignored != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory");
    if (status == PM_OK) {
        pm_objective_weights(r->seen, start);
    }
    for (int i = 0; i < (matrix ? 3 : 2) && status == PM_OK; ++i) {
        r->optimiser = names[i];
        status = run(r, start);
    }
    free(start);
    free(r->ignored);
    return status;
}

static pm_status run_task(const task *k, double factor, const pm_dataset *dataset,
                          const char *configs, FILE *csv) {
    static const char path[] = "bench_optimisers.yaml";
    pm_training *t = NULL;
    pm_samples seen = {.count = 0}, unseen = {.count = 0};
    race r = {.budget = factor * k->budget, .csv = csv};
    pm_status status;
    PM_TRY_DONE(write_training(path, configs, k->width));
    PM_TRY_DONE(pm_training_load(&t, path));
    PM_TRY_DONE(pm_samples_make(&seen, t->scene, dataset, 0, TRAINED, PM_RESIDUAL_STEP, 1, 1));
    PM_TRY_DONE(
        pm_samples_make(&unseen, t->scene, dataset, TRAINED, TRAJECTORIES, PM_RESIDUAL_STEP, 1, 1));
    draw_weights(t);
    PM_TRY_DONE(pm_normalization_of_system(t->system, &seen, false));
    PM_TRY_DONE(pm_objective_open(&r.seen, t->system, &seen, &t->stage[0].loss));
    PM_TRY_DONE(pm_objective_open(&r.unseen, t->system, &unseen, &t->stage[0].loss));
    PM_TRY_DONE(run_all(&r, k->matrix));
done:
    pm_objective_close(r.seen);
    pm_objective_close(r.unseen);
    pm_samples_free(&seen);
    pm_samples_free(&unseen);
    pm_training_free(t);
    return status;
}

int main(int argc, char **argv) {
    if (argc < 3) {
        fprintf(stderr, "usage: run_bench_optimisers CSV CONFIGS [BUDGET]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    const double factor = argc > 3 ? atof(argv[3]) : 1;
    char truth[4096];
    snprintf(truth, sizeof truth, "%s/truth/double_pendulum.yaml", argv[2]);
    pm_dataset *dataset = NULL;
    FILE *csv = fopen(argv[1], "w");
    pm_status status = csv == NULL ? pm_fail(PM_EFILE, "%s: cannot be written", argv[1]) : PM_OK;
    if (status == PM_OK) {
        fprintf(csv, "weights,optimiser,cpu_seconds,iterations,median,mean\n");
        status = bench_simulate(&dataset, truth, TRAJECTORIES);
    }
    for (size_t i = 0; i < sizeof tasks / sizeof *tasks && status == PM_OK; ++i) {
        status = run_task(&tasks[i], factor, dataset, argv[2], csv);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_optimisers: %s\n", pm_error());
    }
    if (csv != NULL) {
        fclose(csv);
    }
    pm_dataset_free(dataset);
    return (int)status;
}
