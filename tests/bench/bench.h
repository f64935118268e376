// Measuring: repetitions of a piece of work, their median and spread, as a table and as CSV. Time
// is the CPU time of the process, all its threads together, so that what else runs on the machine
// counts as little as it can.
#ifndef TESTS_BENCH_H
#define TESTS_BENCH_H

#include "base/status.h"

typedef void bench_work(void *context);

// s, CPU time of the process.
double bench_clock(void);

// Seconds per call of a piece of work: of each repetition the mean over as many calls as take about
// 50 ms; over the repetitions the quartiles.
typedef struct bench_time {
    double median, first_quartile, third_quartile;
} bench_time;

// Several pieces of work measured in turn, repetition by repetition, so that whatever else the
// machine does falls on all of them alike. time: [count].
void bench_measure(int count, bench_work *const *work, void *const *context, bench_time *time);

// A table on standard output, and the same as CSV in the file `path` (NULL: none).
typedef struct bench_table bench_table;
pm_status bench_table_open(bench_table **table, const char *path);
void bench_table_close(bench_table *table);

// A row: a time in microseconds, and where `work` is not 0 its rate in units of 1e9 per second and
// as a ratio to `reference`, a rate of the same run (0: none).
void bench_table_add(bench_table *table, const char *name, bench_time time, double work,
                     double reference);

#endif
