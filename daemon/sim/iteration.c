// Levels of convergence.
#include "sim/iteration.h"

#include <limits.h>
#include <math.h>

void pm_iteration_start(pm_iteration *iteration) {
    *iteration = (pm_iteration){.change = INFINITY, .heard = INT_MAX};
}

void pm_iteration_hear(pm_iteration *iteration, int level) {
    iteration->heard = level < iteration->heard ? level : iteration->heard;
}

bool pm_iteration_end_round(pm_iteration *iteration, double change, int diameter, int left) {
    pm_iteration *it = iteration;
    if (it->last) {
        return true;
    }
    const bool rounding = change <= PM_ITERATION_ROUNDING && change >= it->change;
    it->converged = it->converged || change <= PM_ITERATION_CONVERGED || rounding;
    const int lowest = it->heard < it->level ? it->heard : it->level;
    it->level = it->converged ? lowest + 1 : 0;
    it->change = change;
    it->heard = INT_MAX;
    it->last = it->level > diameter || left <= 1;
    return false;
}
