// Reads required numbers from the configuration of a simulator.
#ifndef PM_TRAINER_TRUTH_NUMBERS_H
#define PM_TRAINER_TRUTH_NUMBERS_H

#include "store/yaml.h"

// Reads the number under `key` of a map, which must lie in [low, high]. PM_ECONFIG.
pm_status pm_truth_number(pm_yaml map, const char *key, double low, double high, double *result);
// Reads the list under `key` of exactly `count` numbers (for one, also a single number) into
// result [count]. PM_ECONFIG, PM_ENOMEM.
pm_status pm_truth_numbers(pm_yaml map, const char *key, int count, pm_arena *arena,
                           double *result);

#endif
