// Reads required numbers and checks their count.
#include "truth/numbers.h"

#include <string.h>

pm_status pm_truth_number(pm_yaml map, const char *key, double low, double high, double *result) {
    pm_yaml value;
    PM_TRY(pm_yaml_require(map, key, &value));
    return pm_yaml_double(value, low, high, result);
}

pm_status pm_truth_numbers(pm_yaml map, const char *key, int count, pm_arena *arena,
                           double *result) {
    pm_yaml list;
    double *value = NULL;
    int found = 0;
    PM_TRY(pm_yaml_require(map, key, &list));
    PM_TRY(pm_yaml_doubles(list, arena, &found, &value));
    if (found != count) {
        return pm_yaml_fail(list, "expected %d numbers, found %d", count, found);
    }
    memcpy(result, value, (size_t)count * sizeof *result);
    return PM_OK;
}
