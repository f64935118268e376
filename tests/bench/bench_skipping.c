// Measures a step of 32 pairs of subsystems of which some are at rest. The cost should be
// proportional to the number of moving pairs, not to the number of pairs in the scene.
//   run_bench_skipping CSV
#include <stdio.h>

#include "base/linalg.h"
#include "bench.h"
#include "lockstep/lattice.h"
#include "sim/monolithic.h"

#define COUNT 64
#define CASES 5

// At rest where x is 0.
static const lattice pairs = {
    .shape = LATTICE_PAIRS,
    .count = COUNT,
    .window = 1,
    .dt = 1e-6, // the state hardly moves, so that untrained weights cannot carry it away
    .part = "energy: {features: [\"|x|^2\"], hidden: [16, 16], skip: quadratic}\n",
    .port = "law: bracket\n"
            "reversible: {learned: {acts_on: [a.x, b.x], features: [\"|a.x|^2\", \"|b.x|^2\"], "
            "hidden: [16]}}\n"};

static void step(void *context) {
    (void)pm_monolithic_step(context);
}

// Terms of one step.
static void count_terms(pm_monolithic *assembly, long *evaluated, long *skipped) {
    const pm_sample *sample = pm_monolithic_sample(assembly);
    *evaluated = *skipped = 0;
    for (int i = 0; i < COUNT; ++i) {
        *evaluated -= sample->evaluated[i];
        *skipped -= sample->skipped[i];
    }
    step(assembly);
    for (int i = 0; i < COUNT; ++i) {
        *evaluated += sample->evaluated[i];
        *skipped += sample->skipped[i];
    }
}

static pm_status measure(const pm_system *system, const char *csv) {
    static const int moving[CASES] = {0, 2, 8, 32, COUNT};
    pm_monolithic *assembly[CASES] = {NULL};
    bench_work *const work[CASES] = {step, step, step, step, step};
    bench_time time[CASES];
    bench_table *table = NULL;
    pm_status status;
    for (int i = 0; i < CASES; ++i) {
        double z[COUNT];
        for (int k = 0; k < COUNT; ++k) {
            z[k] = k < moving[i] ? 1 : 0;
        }
        PM_TRY_DONE(pm_monolithic_open(&assembly[i], system));
        pm_monolithic_set_state(assembly[i], z);
    }
    bench_measure(CASES, work, (void *const *)assembly, time);
    PM_TRY_DONE(bench_table_open(&table, csv));
    for (int i = 0; i < CASES; ++i) {
        char name[64];
        long evaluated, skipped;
        count_terms(assembly[i], &evaluated, &skipped);
        snprintf(name, sizeof name, "%d of %d move: %ld evaluated, %ld skipped", moving[i], COUNT,
                 evaluated, skipped);
        bench_table_add(table, name, time[i], 0, 0);
    }
done:
    bench_table_close(table);
    for (int i = 0; i < CASES; ++i) {
        pm_monolithic_close(assembly[i]);
    }
    return status;
}

int main(int argc, char **argv) {
    if (argc < 2) {
        fprintf(stderr, "usage: run_bench_skipping CSV\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_status status = lattice_make(&scene, &system, &pairs);
    if (status == PM_OK) {
        status = measure(system, argv[1]);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_skipping: %s\n", pm_error());
    }
    pm_system_free(system);
    pm_scene_free(scene);
    return (int)status;
}
