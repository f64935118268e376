// What a subsystem knows of the convergence of all.
#include "sim/iteration.h"

#define BITS 64
// Where no subsystem is farther than FAR ports from another, the bits from SCALE on hold the
// exponent of the largest energy that a subsystem knows of, plus BIAS; 0: all energies are zero.
#define FAR 24
#define SCALE 48
#define BIAS 1100
// Changes that have grown in so many rounds in a row diverge: rounding alone goes up and down.
#define RISING 5

void pm_iteration_hear(pm_iteration *iteration, uint64_t known) {
    const uint64_t scale = known >> SCALE;
    iteration->heard &= known;
    iteration->heard_scale = scale > iteration->heard_scale ? scale : iteration->heard_scale;
}

bool pm_iteration_end_round(pm_iteration *iteration, double change, double open, int diameter,
                            int left) {
    pm_iteration *it = iteration;
    if (it->last) {
        return true;
    }
    const bool near = diameter <= FAR;
    const bool weighs = it->start != 0 && isfinite(it->start);
    const uint64_t own = weighs ? (uint64_t)(ilogb(it->start) + BIAS) : 0;
    it->scale = near && it->heard_scale > own ? it->heard_scale : own;
    const bool counts = open > 0 && (it->scale == 0 || open > ldexp(1, (int)it->scale - BIAS));
    it->rising = change > it->change ? it->rising + 1 : 0;
    const bool small = change <= PM_ITERATION_ACCEPTED && !counts && it->rising < RISING;
    const bool late = near && left <= diameter + 1 && small;
    const bool settled = change <= PM_ITERATION_CONVERGED ||
                         (change <= PM_ITERATION_ROUNDING && change >= it->change);
    // An iterate that hardly changes may leave energy open, as where a stiff gap has closed. What
    // all subsystems store is known where they are near.
    const bool leaves = counts && near && it->keeps_energy;
    const bool converged = (settled && !leaves) || late;
    it->known = (it->known & it->heard) << 1 | (converged ? 1 : 0);
    const bool all = diameter < BITS && (it->known >> diameter & 1) != 0;
    if (near) {
        it->known = (it->known & ((UINT64_C(1) << SCALE) - 1)) | it->scale << SCALE;
    }
    it->change = change;
    it->heard = UINT64_MAX;
    it->last = left <= 1 || all;
    it->gave_up = it->last && !all && near;
    it->stuck = it->last && !all && !near && !converged && !small;
    return false;
}
