// The cost of a coupled step: wall-clock time, CPU time of all processes, and bytes on the network.
#ifndef TESTS_BENCH_COST_H
#define TESTS_BENCH_COST_H

typedef struct cost {
    double mean, p50, p99; // us per step; percentiles of means over `block` consecutive steps
    double cpu;            // us per step, all processes
    double bytes;          // per step, including IP headers
} cost;

// Computes the cost per step from the times at which the steps were complete (time [steps + 1], s)
// and from the CPU time (s) and the bytes of all steps together. `time` is overwritten.
cost cost_of(int steps, int block, double *time, double cpu, double bytes);

// Returns the bytes of IP multicast that this network namespace has sent.
double cost_bytes_sent(void);

// Returns the CPU time of this process, s.
double cost_cpu_of_self(void);

#endif
