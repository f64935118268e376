// Measures the time of pieces of work, and prints median and quartiles as a table and as CSV. Times
// are CPU times of the process, summed over its threads, so that other programs on the machine have
// little influence.
#ifndef TESTS_BENCH_H
#define TESTS_BENCH_H

#include "base/status.h"

typedef void bench_work(void *context);

// Returns the CPU time of the process, s.
double bench_clock(void);

// Seconds per call of a piece of work. A repetition gives the mean over as many calls as take about
// 50 ms; the quartiles are taken over the repetitions.
typedef struct bench_time {
    double median, first_quartile, third_quartile;
} bench_time;

// Measures `count` pieces of work in turn, repetition by repetition, so that disturbances by other
// programs affect all of them equally. time: [count].
void bench_measure(int count, bench_work *const *work, void *const *context, bench_time *time);

// A table on standard output, which is also written as CSV to the file `path` (NULL: no file).
typedef struct bench_table bench_table;
pm_status bench_table_open(bench_table **table, const char *path);
void bench_table_close(bench_table *table);

// Adds a row with a time in microseconds. If `work`, the number of operations per call, is not 0,
// the row also has the rate in 1e9 operations per second, and its ratio to `reference`, a rate
// measured in the same run (0: none).
void bench_table_add(bench_table *table, const char *name, bench_time time, double work,
                     double reference);

#endif
