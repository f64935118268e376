// Repeats the work, computes quartiles and prints tables.
#include "bench.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "sim/score.h"

#define REPETITIONS 15
#define SECONDS 0.05 // of one repetition
#define MOST 32

double bench_clock(void) {
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double seconds_of(bench_work *work, void *context, long calls) {
    const double start = bench_clock();
    for (long i = 0; i < calls; ++i) {
        work(context);
    }
    return bench_clock() - start;
}

// How many calls take about SECONDS; also warms up.
static long calibrate(bench_work *work, void *context) {
    long calls = 1;
    for (double seconds = 0; (seconds = seconds_of(work, context, calls)) < 0.2 * SECONDS;) {
        calls = seconds > 0.001 * SECONDS ? (long)(0.5 * SECONDS / seconds * (double)calls) + 1
                                          : 10 * calls;
    }
    return calls;
}

void bench_measure(int count, bench_work *const *work, void *const *context, bench_time *time) {
    double value[MOST][REPETITIONS];
    long calls[MOST];
    for (int i = 0; i < count; ++i) {
        calls[i] = calibrate(work[i], context[i]);
    }
    for (int r = 0; r < REPETITIONS; ++r) {
        for (int i = 0; i < count; ++i) {
            value[i][r] = seconds_of(work[i], context[i], calls[i]) / (double)calls[i];
        }
    }
    for (int i = 0; i < count; ++i) {
        const pm_box box = pm_box_of(REPETITIONS, value[i]);
        time[i] = (bench_time){box.median, box.first_quartile, box.third_quartile};
    }
}

struct bench_table {
    FILE *csv; // NULL: none
};

pm_status bench_table_open(bench_table **table, const char *path) {
    bench_table *t = calloc(1, sizeof *t);
    if (t == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a table");
    }
    if (path != NULL && (t->csv = fopen(path, "w")) == NULL) {
        free(t);
        return pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    printf("%-44s %10s %10s %10s %8s %6s\n", "", "median, us", "quartile", "quartile", "G/s",
           "ratio");
    if (t->csv != NULL) {
        fprintf(t->csv, "what,median_us,first_quartile_us,third_quartile_us,rate_1e9,ratio\n");
    }
    *table = t;
    return PM_OK;
}

void bench_table_close(bench_table *table) {
    if (table != NULL) {
        if (table->csv != NULL) {
            fclose(table->csv);
        }
        free(table);
    }
}

static void print_number(FILE *file, const char *format, double value) {
    if (value > 0) {
        fprintf(file, format, value);
    }
}

void bench_table_add(bench_table *table, const char *name, bench_time time, double work,
                     double reference) {
    const double rate = work / time.median / 1e9;
    const double ratio = reference > 0 ? rate / reference : 0;
    printf("%-44s %10.2f %10.2f %10.2f", name, 1e6 * time.median, 1e6 * time.first_quartile,
           1e6 * time.third_quartile);
    print_number(stdout, " %8.2f", rate);
    print_number(stdout, " %6.2f", ratio);
    printf("\n");
    if (table->csv != NULL) {
        fprintf(table->csv, "\"%s\",%.6g,%.6g,%.6g,", name, 1e6 * time.median,
                1e6 * time.first_quartile, 1e6 * time.third_quartile);
        print_number(table->csv, "%.6g", rate);
        fputc(',', table->csv);
        print_number(table->csv, "%.6g", ratio);
        fputc('\n', table->csv);
    }
}
