// Computes percentiles, and reads the counters of the kernel.
#include "cost.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

cost cost_of(int steps, int block, double *time, double cpu, double bytes) {
    const int count = steps / block;
    const double mean = 1e6 * (time[steps] - time[0]) / steps;
    for (int i = 0; i < count; ++i) {
        time[i] = 1e6 * (time[(i + 1) * block] - time[i * block]) / block;
    }
    qsort(time, (size_t)count, sizeof *time, compare);
    return (cost){mean, time[count / 2], time[count * 99 / 100], 1e6 * cpu / steps, bytes / steps};
}

// Finds a counter in a file of pairs of lines: names, then numbers in the same order.
double cost_bytes_sent(void) {
    char names[8192], numbers[8192];
    double bytes = 0;
    FILE *file = fopen("/proc/net/netstat", "r");
    while (file != NULL && fgets(names, sizeof names, file) != NULL &&
           fgets(numbers, sizeof numbers, file) != NULL) {
        char *name_rest, *number_rest;
        const char *name = strtok_r(names, " \n", &name_rest);
        const char *number = strtok_r(numbers, " \n", &number_rest);
        while (name != NULL && number != NULL) {
            if (strcmp(name, "OutMcastOctets") == 0) {
                bytes = atof(number);
            }
            name = strtok_r(NULL, " \n", &name_rest);
            number = strtok_r(NULL, " \n", &number_rest);
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return bytes;
}

double cost_cpu_of_self(void) {
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}
