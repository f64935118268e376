// Measures the cost of a coupled step: chains and rings of trivial subsystems, in one process and
// in a process each, received by portmet's own receiver and by liblcm, in strict lock-step and with
// a window of 16. Rings without models over liblcm, over the own receiver and over futexes are
// measured in the same run for comparison, and so are steps of the double pendulum. Run it in a
// private network (loopback.sh).
//   run_bench_lockstep CSV CONFIGS [LARGEST]
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "coupled.h"
#include "lattice.h"
#include "ring.h"
#include "scene/columns.h"

#define ADDRESS "udpm://239.255.76.67:7667?ttl=0"
#define LARGEST 64
#define REPETITIONS 3 // of every case, in turn; the median is shown
#define WINDOW 16
// Many processes that all wake for every message, as with liblcm, take 100 ms a step.
#define LARGEST_CHAIN_LCM 16

typedef enum bench_way {
    BARE_LCM,
    BARE_OWN,
    BARE_FUTEX,
    IN_PROCESS,
    OWN_RECEIVE,
    LCM_RECEIVE,
} bench_way;

static const char *const way_names[] = {"bare ring, liblcm",      "bare ring, own receive",
                                        "bare ring, futex",       "in process",
                                        "processes, own receive", "processes, liblcm receive"};

// A line of the table.
typedef struct bench_case {
    const char *scene; // "ring", "chain", or a file's name
    bool is_file;
    int count, window;
    bench_way way;
    cost cost[REPETITIONS];
} bench_case;

// --- one run ---

// A fraction of a second, or few seconds.
static int steps_of(const bench_case *c) {
    if (c->way == IN_PROCESS) {
        return c->is_file ? 800 : 9600;
    }
    return c->is_file ? 160 : (c->way == LCM_RECEIVE ? 1024 : 4096) / c->count;
}

static pm_status run_ring(const bench_case *c, cost *result) {
    static const ring_kind kinds[] = {RING_LCM, RING_OWN, RING_FUTEX};
    const char *url = c->way == BARE_LCM ? ADDRESS "&recv_buf_size=4000000" : ADDRESS;
    return ring_run(kinds[c->way], url, c->count, steps_of(c), result);
}

// The scene, its models, and where it starts: z [scene->nz], NULL for the scene's own.
static pm_status load_file(const bench_case *c, pm_scene **scene, pm_system **system, double **z) {
    pm_dataset *reference = NULL;
    pm_columns columns;
    pm_status status;
    PM_TRY(pm_scene_load(scene, c->scene));
    (*scene)->network.window = c->window;
    PM_TRY(pm_system_load(system, *scene, NULL));
    PM_TRY(pm_dataset_load(&reference, (*scene)->run.reference));
    PM_TRY_DONE(pm_columns_bind(&columns, *scene, reference, &(*scene)->arena));
    *z = pm_arena_array(&(*scene)->arena, (size_t)(*scene)->physics.nz, sizeof **z);
    if (*z == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a state");
        goto done;
    }
    pm_columns_to_state(&columns,
                        pm_dataset_state(reference, (*scene)->run.reference_trajectory, 0), *z);
done:
    pm_dataset_free(reference);
    return status;
}

static pm_status run_scene(const bench_case *c, cost *result) {
    static const char *const urls[] = {
        [IN_PROCESS] = NULL, [OWN_RECEIVE] = ADDRESS, [LCM_RECEIVE] = ADDRESS "&receive=lcm"};
    const lattice l = {.shape = strcmp(c->scene, "ring") == 0 ? LATTICE_RING : LATTICE_CHAIN,
                       .count = c->count,
                       .window = c->window,
                       .dt = 1e-3,
                       .part = lattice_trivial_part,
                       .port = lattice_trivial_port};
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    double *z = NULL;
    pm_status status;
    PM_TRY_DONE(c->is_file ? load_file(c, &scene, &system, &z) : lattice_make(&scene, &system, &l));
    if (c->way == IN_PROCESS) {
        PM_TRY_DONE(pm_scene_merge_processes(scene));
    }
    status = coupled_run(system, urls[c->way], z, steps_of(c), result);
done:
    pm_system_free(system);
    pm_scene_free(scene);
    return status;
}

// --- the table ---

#define CASES_MAX 128

typedef struct bench_list {
    int count;
    bench_case item[CASES_MAX];
} bench_list;

static void add(bench_list *list, const char *scene, int count, int way, int window) {
    if (list->count < CASES_MAX) {
        list->item[list->count++] = (bench_case){.scene = scene,
                                                 .is_file = strchr(scene, '/') != NULL,
                                                 .count = count,
                                                 .window = window,
                                                 .way = (bench_way)way};
    }
}

static void list_cases(bench_list *list, int largest, const char *pendulum) {
    static const int windows[] = {1, WINDOW};
    for (int count = 2; count <= largest; count *= 2) {
        for (int way = BARE_LCM; way <= BARE_FUTEX; ++way) {
            add(list, "ring", count, way, 1);
        }
        for (int way = IN_PROCESS; way <= LCM_RECEIVE; ++way) {
            for (int i = 0; i < 2; ++i) {
                add(list, "ring", count, way, windows[i]);
                if (way != LCM_RECEIVE || count <= LARGEST_CHAIN_LCM) {
                    add(list, "chain", count, way, windows[i]);
                }
            }
        }
    }
    for (int way = IN_PROCESS; way <= LCM_RECEIVE; ++way) {
        for (int i = 0; i < 2; ++i) {
            add(list, pendulum, 2, way, windows[i]);
        }
    }
}

static int compare(const void *a, const void *b) {
    const double x = ((const cost *)a)->mean, y = ((const cost *)b)->mean;
    return x < y ? -1 : x > y;
}

static const cost *median(const bench_case *c) {
    return &c->cost[REPETITIONS / 2];
}

// us of the bare ring over liblcm with as many processes; 0: there is none.
static double reference_of(const bench_list *list, const bench_case *c) {
    for (int i = 0; i < list->count && !c->is_file; ++i) {
        if (list->item[i].way == BARE_LCM && list->item[i].count == c->count) {
            return median(&list->item[i])->mean;
        }
    }
    return 0;
}

static void print_case(const bench_case *c, double reference, FILE *csv) {
    const cost *r = median(c);
    const char *slash = strrchr(c->scene, '/'), *name = slash == NULL ? c->scene : slash + 1;
    const double fastest = c->cost[0].mean, slowest = c->cost[REPETITIONS - 1].mean;
    const double ratio = reference > 0 ? r->mean / reference : 0;
    printf("%-20s %3d  %-26s %6d %9.2f %8.2f %8.2f %8.2f %9.2f %9.2f %8.0f", name, c->count,
           way_names[c->way], c->window, r->mean, fastest, slowest, r->p50, r->p99, r->cpu,
           r->bytes);
    printf(ratio > 0 ? " %7.2f\n" : "\n", ratio);
    fprintf(csv, "%s,%d,\"%s\",%d,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.4g\n", name, c->count,
            way_names[c->way], c->window, r->mean, fastest, slowest, r->p50, r->p99, r->cpu,
            r->bytes, ratio);
}

static void print_table(bench_list *list, FILE *csv) {
    for (int i = 0; i < list->count; ++i) {
        qsort(list->item[i].cost, REPETITIONS, sizeof(cost), compare);
    }
    printf("%-20s %3s  %-26s %6s %9s %8s %8s %8s %9s %9s %8s %7s\n", "us per coupled step", "N", "",
           "window", "median", "fastest", "slowest", "p50", "p99", "CPU", "bytes", "ratio");
    fprintf(csv, "scene,subsystems,how,window,median_us,fastest_us,slowest_us,p50_us,p99_us,cpu_us,"
                 "bytes,ratio_to_bare_liblcm_ring\n");
    for (int i = 0; i < list->count; ++i) {
        print_case(&list->item[i], reference_of(list, &list->item[i]), csv);
    }
}

static pm_status measure(const char *csv_path, const char *configs, int largest) {
    static bench_list list; // too large for the stack
    char pendulum[4096];
    snprintf(pendulum, sizeof pendulum, "%s/double_pendulum.yaml", configs);
    list_cases(&list, largest, pendulum);
    for (int repetition = 0; repetition < REPETITIONS; ++repetition) {
        for (int i = 0; i < list.count; ++i) {
            bench_case *c = &list.item[i];
            cost *result = &c->cost[repetition];
            PM_TRY(c->way <= BARE_FUTEX ? run_ring(c, result) : run_scene(c, result));
        }
        fprintf(stderr, "%d of %d rounds\n", repetition + 1, REPETITIONS);
    }
    FILE *csv = fopen(csv_path, "w");
    if (csv == NULL) {
        return pm_fail(PM_EFILE, "cannot write %s", csv_path);
    }
    print_table(&list, csv);
    fclose(csv);
    return PM_OK;
}

int main(int argc, char **argv) {
    if (argc != 3 && argc != 4) {
        fprintf(stderr, "usage: run_bench_lockstep CSV CONFIGS [LARGEST]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    const pm_status status = measure(argv[1], argv[2], argc == 4 ? atoi(argv[3]) : LARGEST);
    if (status != PM_OK) {
        fprintf(stderr, "bench_lockstep: %s\n", pm_error());
    }
    return (int)status;
}
