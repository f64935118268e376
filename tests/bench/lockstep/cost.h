// What a coupled step costs: time, CPU of all processes, bytes on the network.
#ifndef TESTS_BENCH_COST_H
#define TESTS_BENCH_COST_H

typedef struct cost {
    double mean, p50, p99; // us per step; percentiles of means over `block` consecutive steps
    double cpu;            // us per step, all processes
    double bytes;          // per step, IP's heads included
} cost;

// From time [steps + 1] s, when each step was complete, the CPU time in s and the bytes of them
// all. `time` is overwritten.
cost cost_of(int steps, int block, double *time, double cpu, double bytes);

// Bytes of IP multicast that this network namespace has sent.
double cost_bytes_sent(void);

// s of CPU time.
double cost_cpu_of_self(void);

#endif
