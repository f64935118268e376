// What a subsystem knows of the convergence of all.
#include "sim/iteration.h"

#define BITS 64

void pm_iteration_hear(pm_iteration *iteration, uint64_t known) {
    iteration->heard &= known;
}

bool pm_iteration_end_round(pm_iteration *iteration, double change, int diameter, int left) {
    pm_iteration *it = iteration;
    if (it->last) {
        return true;
    }
    const bool rounding = change <= PM_ITERATION_ROUNDING && change >= it->change;
    const bool converged = change <= PM_ITERATION_CONVERGED || rounding;
    it->known = (it->known & it->heard) << 1 | (converged ? 1 : 0);
    it->change = change;
    it->heard = UINT64_MAX;
    it->last = left <= 1 || (diameter < BITS && (it->known >> diameter & 1) != 0);
    return false;
}
