// Makes the data of the benches of training in memory.
#ifndef TESTS_BENCH_SIMULATE_H
#define TESTS_BENCH_SIMULATE_H

#include "base/status.h"
#include "store/dataset.h"

// Simulates the first `count` trajectories of the truth configuration at `path`. The caller frees
// the dataset, on failure too. Fails as pm_truth_load and pm_truth_run do; PM_ENOMEM.
pm_status bench_simulate(pm_dataset **dataset, const char *path, int count);

#endif
