// Vectors of eight numbers that the compiler keeps in the processor's vector registers, whatever
// their width. Sums over the lanes have a fixed order, so that every processor gives the same bits.
#ifndef PM_BASE_LANES_H
#define PM_BASE_LANES_H

#include <stddef.h>
#include <string.h>

#define PM_LANES 8

typedef double pm_lane __attribute__((vector_size(PM_LANES * sizeof(double))));
typedef float pm_narrow_lane __attribute__((vector_size(PM_LANES * sizeof(float))));

// A function of vectors becomes part of its caller, because the widest registers that it may use
// are those of the caller (simd.h).
#define PM_LANE_FUNCTION static inline __attribute__((always_inline))

// Copy `count` vectors from x [count][PM_LANES] to `to`, and from `from` to x.
PM_LANE_FUNCTION void pm_lanes_load(int count, const double *x, pm_lane *to) {
    memcpy(to, x, (size_t)count * sizeof *to);
}
PM_LANE_FUNCTION void pm_lanes_store(int count, const pm_lane *from, double *x) {
    memcpy(x, from, (size_t)count * sizeof *from);
}

// Returns the sum over the lanes.
PM_LANE_FUNCTION double pm_lane_sum(const pm_lane *x) {
    const pm_lane v = *x;
    return ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7]));
}

#endif
