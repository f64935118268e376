// An euler step of the whole double pendulum in one process on one core, both parts and the joint
// with its books: hard form, weights drawn at random, which costs what trained ones do.
//   run_bench_step CSV CONFIGS
#include <stdio.h>
#include <stdlib.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "bench.h"
#include "sim/assembly.h"
#include "training.h"

// s; the state hardly moves, so that untrained weights cannot carry it away.
#define DT 1e-9
// us, of the method authors' program in the same sense.
#define REFERENCE 250.0

static void step(void *context) {
    // The state is finite: see DT.
    (void)pm_assembly_step(context);
}

static void draw_weights(const pm_training *t) {
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        pm_rng rng;
        pm_rng_init(&rng, 1, (uint64_t)i);
        pm_params_randomise(pm_system_params(t->system, i), &rng);
    }
}

static pm_status measure(pm_training *t, const char *csv) {
    static const double start[] = {4.5, 4.4, -0.5, 1.4, -0.1, -2.7, 0.1, 1.4, -0.2, 0.1};
    static const char *const names[] = {"euler", "heun", "rk4"};
    pm_assembly *assembly[3] = {NULL};
    bench_work *const work[] = {step, step, step};
    bench_time time[3];
    bench_table *table = NULL;
    pm_status status;
    draw_weights(t);
    t->scene->dt = DT;
    t->scene->substeps = 1;
    for (int i = 0; i < 3; ++i) {
        t->scene->integrator = names[i];
        PM_TRY_DONE(pm_assembly_open(&assembly[i], t->system));
        pm_assembly_set_state(assembly[i], start);
    }
    bench_measure(3, work, (void *const *)assembly, time);
    PM_TRY_DONE(bench_table_open(&table, csv));
    for (int i = 0; i < 3; ++i) {
        bench_table_add(table, names[i], time[i], 0, 0);
    }
    printf("the double pendulum, one step; %.0f us take an euler step in the authors' program: "
           "%.0f times as long\n",
           REFERENCE, REFERENCE / (1e6 * time[0].median));
done:
    bench_table_close(table);
    for (int i = 0; i < 3; ++i) {
        pm_assembly_close(assembly[i]);
    }
    return status;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: run_bench_step CSV CONFIGS\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    char path[4096];
    snprintf(path, sizeof path, "%s/train/double_pendulum.yaml", argv[2]);
    pm_training *training = NULL;
    pm_status status = pm_training_load(&training, path);
    if (status == PM_OK) {
        status = measure(training, argv[1]);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_step: %s\n", pm_error());
    }
    pm_training_free(training);
    return (int)status;
}
