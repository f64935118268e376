// Measures the error of one chain of links, link by link, against the truth simulator. Positions
// are compared as the scene has them, each measured from the link before, so that the length of the
// chain does not make an error look small.
//   run_bench_chain SCENE DATA SUBSTEPS [TOLERANCE]
// Prints one row: the median, the mean and the largest relative L2 error of q, p and s over all
// links and trajectories; the median over trajectories of the error of the whole chain; the error
// of the entropy produced; the largest drift of the energy.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "evaluate/evaluate.h"
#include "sim/monolithic.h"

#define GROUPS 3 // q, p, s

// Sums of squares over a trajectory.
typedef struct sums {
    double error, norm;
} sums;

typedef struct bench {
    pm_scene *scene;
    pm_system *system;
    pm_dataset *truth;
    pm_evaluation *evaluation;
    double *z[2];          // [nz] predicted and true state
    sums *link;            // [nsubsystem][GROUPS] of one trajectory
    double *error[GROUPS]; // [ntrajectory nsubsystem]
    double *whole[GROUPS]; // [ntrajectory]
    double *production;    // [ntrajectory]
} bench;

static pm_status open_bench(bench *b, char **argv, int argc) {
    PM_TRY(pm_scene_load(&b->scene, argv[1]));
    b->scene->physics.substeps = atoi(argv[3]);
    b->scene->physics.tolerance = argc > 4 ? atof(argv[4]) : 0;
    PM_TRY(pm_system_load(&b->system, b->scene, NULL));
    PM_TRY(pm_dataset_load(&b->truth, argv[2]));
    const size_t n = (size_t)b->scene->physics.nsubsystem, count = (size_t)b->truth->ntrajectory;
    bool made = true;
    for (int i = 0; i < 2; ++i) {
        made = (b->z[i] = calloc((size_t)b->scene->physics.nz, sizeof(double))) != NULL && made;
    }
    for (int g = 0; g < GROUPS; ++g) {
        made = (b->error[g] = calloc(n * count, sizeof(double))) != NULL && made;
        made = (b->whole[g] = calloc(count, sizeof(double))) != NULL && made;
    }
    b->link = calloc(n * GROUPS, sizeof *b->link);
    b->production = calloc(count, sizeof(double));
    return made && b->link != NULL && b->production != NULL
               ? PM_OK
               : pm_fail(PM_ENOMEM, "out of memory for a benchmark");
}

static void close_bench(bench *b) {
    pm_evaluation_free(b->evaluation);
    pm_dataset_free(b->truth);
    pm_system_free(b->system);
    pm_scene_free(b->scene);
    for (int i = 0; i < 2; ++i) {
        free(b->z[i]);
    }
    for (int g = 0; g < GROUPS; ++g) {
        free(b->error[g]);
        free(b->whole[g]);
    }
    free(b->link);
    free(b->production);
}

// Adds the squares of one state to the sums of each link, whose components are q[2] p[2] s.
static void add_state(bench *b) {
    static const int begin[GROUPS + 1] = {0, 2, 4, 5};
    for (int k = 0; k < b->scene->physics.nsubsystem; ++k) {
        for (int g = 0; g < GROUPS; ++g) {
            sums *s = &b->link[k * GROUPS + g];
            for (int i = begin[g]; i < begin[g + 1]; ++i) {
                const double predicted = b->z[0][5 * k + i], truth = b->z[1][5 * k + i];
                s->error += (predicted - truth) * (predicted - truth);
                s->norm += truth * truth;
            }
        }
    }
}

static double total_entropy(const bench *b, const double *z) {
    double entropy = 0;
    for (int k = 0; k < b->scene->physics.nsubsystem; ++k) {
        entropy += z[5 * k + 4];
    }
    return entropy;
}

static void measure_trajectory(bench *b, int trajectory) {
    const pm_columns *columns = &b->evaluation->columns;
    const int n = b->scene->physics.nsubsystem, ntime = b->truth->ntime;
    double entropy[2][2]; // predicted and true, at the start and at the end
    memset(b->link, 0, (size_t)n * GROUPS * sizeof *b->link);
    for (int j = 0; j < ntime; ++j) {
        pm_columns_to_state(columns, pm_dataset_state(b->evaluation->predicted, trajectory, j),
                            b->z[0]);
        pm_columns_to_state(columns, pm_dataset_state(b->truth, trajectory, j), b->z[1]);
        add_state(b);
        for (int i = 0; i < 2; ++i) {
            entropy[i][j > 0] = total_entropy(b, b->z[i]);
        }
    }
    for (int g = 0; g < GROUPS; ++g) {
        sums whole = {0, 0};
        for (int k = 0; k < n; ++k) {
            const sums *s = &b->link[k * GROUPS + g];
            b->error[g][trajectory * n + k] = sqrt(s->error / s->norm);
            whole.error += s->error;
            whole.norm += s->norm;
        }
        b->whole[g][trajectory] = sqrt(whole.error / whole.norm);
    }
    b->production[trajectory] =
        fabs((entropy[0][1] - entropy[0][0]) / (entropy[1][1] - entropy[1][0]) - 1);
}

static void print_row(bench *b) {
    const int n = b->scene->physics.nsubsystem, count = b->truth->ntrajectory;
    double drift = 0;
    for (int i = 0; i < count; ++i) {
        drift = fmax(drift, b->evaluation->rollout[i].ledger.energy_drift);
    }
    printf("%5d %4d %4d", n, count, b->scene->physics.substeps);
    for (int g = 0; g < GROUPS; ++g) {
        const pm_box box = pm_box_of(n * count, b->error[g]);
        printf("  %.1e %.1e %.1e %.1e", 100 * box.median, 100 * box.third_quartile, 100 * box.mean,
               100 * box.largest);
    }
    for (int g = 0; g < GROUPS; ++g) {
        printf(" %s%.1e", g == 0 ? " " : "", 100 * pm_box_of(count, b->whole[g]).median);
    }
    const pm_box production = pm_box_of(count, b->production);
    printf("  %.1e %.1e  %.1e\n", 100 * production.median, 100 * production.mean, drift);
}

static pm_status run(bench *b, char **argv, int argc) {
    const pm_evaluate_how how = {.threads = 1};
    PM_TRY(open_bench(b, argv, argc));
    PM_TRY(pm_evaluate(&b->evaluation, b->system, b->truth, 0, b->truth->ntrajectory, &how));
    for (int i = 0; i < b->truth->ntrajectory; ++i) {
        measure_trajectory(b, i);
    }
    print_row(b);
    return PM_OK;
}

int main(int argc, char **argv) {
    if (argc < 4 || argc > 5) {
        fprintf(stderr, "usage: run_bench_chain SCENE DATA SUBSTEPS [TOLERANCE]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    bench b = {0};
    const pm_status status = run(&b, argv, argc);
    if (status != PM_OK) {
        fprintf(stderr, "bench_chain: %s\n", pm_error());
    }
    close_bench(&b);
    return (int)status;
}
