// Numbers that a simulator's configuration must give.
#ifndef PM_TRAINER_TRUTH_NUMBERS_H
#define PM_TRAINER_TRUTH_NUMBERS_H

#include "store/yaml.h"

// The number that `map` has under `key`, within [low, high]. PM_ECONFIG.
pm_status pm_truth_number(pm_yaml map, const char *key, double low, double high, double *result);
// The list (or single number) of exactly `count` numbers under `key`. PM_ECONFIG, PM_ENOMEM.
pm_status pm_truth_numbers(pm_yaml map, const char *key, int count, pm_arena *arena,
                           double *result);

#endif
