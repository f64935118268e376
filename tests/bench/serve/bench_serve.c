// Measures what a client of `portmetd serve` waits for, through libportmet: a run of some steps,
// its start, and single steps. Each run is compared with the same run in this process, bit by bit.
//   run_bench_serve SCENE RUNS STEPS SINGLE
// asks for SINGLE steps one by one after each run, and prints a line for each piece of work: the
// least, the median and the quartiles of its time, in us.
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "portmet.h"

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void require(bool holds) {
    if (!holds) {
        fprintf(stderr, "bench_serve: %s\n", portmet_error());
        exit(1);
    }
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void print(const char *what, double *seconds, int count) {
    qsort(seconds, (size_t)count, sizeof *seconds, compare);
    printf("%-28s least %9.1f   median %9.1f   quartiles %9.1f %9.1f us\n", what, 1e6 * seconds[0],
           1e6 * seconds[count / 2], 1e6 * seconds[count / 4], 1e6 * seconds[3 * count / 4]);
}

int main(int argc, char **argv) {
    if (argc != 5) {
        fprintf(stderr, "usage: run_bench_serve SCENE RUNS STEPS SINGLE\n");
        return 2;
    }
    const int runs = atoi(argv[2]), steps = atoi(argv[3]), single = atoi(argv[4]);
    portmet_scene *here = NULL, *there = NULL;
    double *time[4]; // of a whole run, of its start, of its steps, of one step
    size_t nz;
    require(portmet_scene_open(&here, argv[1], NULL) == PORTMET_OK);
    require(portmet_scene_connect(&there, portmet_scene_name(here, PORTMET_SCENE, 0), NULL, NULL,
                                  NULL, 0) == PORTMET_OK);
    require(portmet_scene_step(here, steps) == PORTMET_OK);
    const double *z = portmet_scene_array(here, PORTMET_STATE, &nz);
    const double *served = portmet_scene_array(there, PORTMET_STATE, NULL);
    for (int i = 0; i < 4; ++i) {
        time[i] = malloc((size_t)runs * sizeof *time[i]);
        require(time[i] != NULL);
    }
    for (int run = 0; run < runs; ++run) {
        const double start = now();
        require(portmet_scene_restart(there, NULL) == PORTMET_OK);
        const double begun = now();
        require(portmet_scene_step(there, steps) == PORTMET_OK);
        const double end = now();
        if (memcmp(z, served, nz * sizeof *z) != 0) {
            fprintf(stderr, "bench_serve: run %d has other bits\n", run);
            return 1;
        }
        for (int i = 0; i < single; ++i) {
            require(portmet_scene_step(there, 1) == PORTMET_OK);
        }
        time[3][run] = (now() - end) / (single > 0 ? single : 1);
        time[0][run] = end - start;
        time[1][run] = begun - start;
        time[2][run] = (end - begun) / steps;
    }
    print("a run", time[0], runs);
    print("its start", time[1], runs);
    print("one of many steps", time[2], runs);
    if (single > 0) {
        print("one step alone, from C", time[3], runs);
    }
    portmet_scene_close(there);
    portmet_scene_close(here);
    return 0;
}
