// Measures one iteration of every optimiser on the double pendulum of
// configs/train/double_pendulum_network.yaml with 40 simulated trajectories: an epoch of adam, an
// evaluation of L-BFGS over all samples, and a Levenberg-Marquardt step on a batch. Graphs are
// built before the clock starts. CPU times are summed over two threads; on two cores the wall-clock
// time is half as long.
//   run_bench_iteration CSV CONFIGS
#include <stdio.h>
#include <stdlib.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "bench.h"
#include "fit/normalization.h"
#include "fit/training.h"
#include "sim/score.h"
#include "simulate.h"

#define TRAJECTORIES 40
#define ITERATIONS 9
#define SUBSTEPS 4
#define BATCH 1024

// --- timing ---

// The clock at each report of an optimiser; the first iteration warms up.
typedef struct clock_book {
    double last, seconds[ITERATIONS];
} clock_book;

static pm_status book(void *context, const pm_optimisation *o, double loss) {
    (void)loss;
    clock_book *b = context;
    const double now = bench_clock();
    if (o->done >= 2 && o->done - 2 < ITERATIONS) {
        b->seconds[o->done - 2] = now - b->last;
    }
    b->last = bench_clock();
    return PM_OK;
}

static pm_status time_optimiser(bench_table *table, const char *name, pm_objective *objective,
                                double *work) {
    const int size = pm_objective_size(objective);
    clock_book clock = {.last = 0};
    double *theta = work, *moment = work + size;
    pm_optimisation o = {.objective = objective,
                         .schedule = {.iterations = ITERATIONS + 1,
                                      .batch = BATCH,
                                      .beta2 = 0.999,
                                      .first_rate = 1e-4,
                                      .last_rate = 1e-4,
                                      .memory = 30},
                         .seed = 1,
                         .theta = theta,
                         .moment = moment,
                         .report = book,
                         .context = &clock};
    pm_objective_set_weights(objective, theta);
    PM_TRY(pm_optimiser_find(name)->run(&o));
    const pm_box box = pm_box_of(o.done - 1, clock.seconds);
    char label[64];
    snprintf(label, sizeof label, "%s, %d samples", name,
             name[0] == 'g' ? BATCH : pm_objective_samples(objective));
    bench_table_add(table, label, (bench_time){box.median, box.first_quartile, box.third_quartile},
                    0, 0);
    return PM_OK;
}

static void draw_weights(const pm_training *t, double *theta) {
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        pm_params *params = pm_system_params(t->system, i);
        pm_rng rng;
        pm_rng_init(&rng, t->seed, (uint64_t)i);
        pm_params_randomise(params, &rng);
        pm_params_gather(params, theta);
        theta += pm_params_trained(params);
    }
}

static pm_status measure(pm_training *t, const pm_dataset *dataset, const char *csv) {
    static const char *const names[] = {"adam", "lbfgs", "gauss_newton"};
    pm_samples samples = {.count = 0};
    pm_objective *objective = NULL;
    bench_table *table = NULL;
    double *start = NULL, *work = NULL;
    pm_status status;
    pm_loss loss = t->stage[0].loss;
    loss.substeps = SUBSTEPS;
    PM_TRY_DONE(pm_samples_make(&samples, t->scene, dataset, 0, TRAJECTORIES, loss.residual, 1,
                                pm_loss_input_order(&loss)));
    PM_TRY_DONE(pm_normalization_of_system(t->system, &samples, true));
    PM_TRY_DONE(pm_objective_open(&objective, t->system, &samples, &loss));
    const int size = pm_objective_size(objective);
    start = calloc((size_t)size, sizeof *start);
    if (start == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory");
        goto done;
    }
    draw_weights(t, start);
    PM_TRY_DONE(bench_table_open(&table, csv));
    for (int i = 0; i < 3; ++i) {
        free(work);
        work = calloc(3 * (size_t)size, sizeof *work);
        if (work == NULL) {
            status = pm_fail(PM_ENOMEM, "out of memory");
            goto done;
        }
        for (int k = 0; k < size; ++k) {
            work[k] = start[k];
        }
        PM_TRY_DONE(time_optimiser(table, names[i], objective, work));
    }
    printf("the double pendulum, %d weights, rk4 with %d substeps; CPU time of two threads\n", size,
           SUBSTEPS);
done:
    bench_table_close(table);
    pm_objective_close(objective);
    pm_samples_free(&samples);
    free(start);
    free(work);
    return status;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: run_bench_iteration CSV CONFIGS\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    char training_path[4096], truth_path[4096];
    snprintf(training_path, sizeof training_path, "%s/train/double_pendulum_network.yaml", argv[2]);
    snprintf(truth_path, sizeof truth_path, "%s/truth/double_pendulum.yaml", argv[2]);
    pm_training *training = NULL;
    pm_dataset *dataset = NULL;
    pm_status status;
    PM_TRY_DONE(pm_training_load(&training, training_path));
    PM_TRY_DONE(bench_simulate(&dataset, truth_path, TRAJECTORIES));
    PM_TRY_DONE(measure(training, dataset, argv[1]));
done:
    if (status != PM_OK) {
        fprintf(stderr, "bench_iteration: %s\n", pm_error());
    }
    pm_dataset_free(dataset);
    pm_training_free(training);
    return (int)status;
}
