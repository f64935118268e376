// Inner loops run over PM_LANES lanes, which the compiler keeps in registers.
#include "sim/lanes.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "base/linalg.h"
#include "base/simd.h"

static inline uint64_t bits_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

pm_status pm_lane_flux_new(pm_lane_flux *flux, pm_arena *arena, int lanes) {
    double *memory = pm_arena_array(arena, 4 * (size_t)lanes, sizeof *memory);
    const ptrdiff_t n = lanes;
    if (memory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the fluxes of %d lanes", lanes);
    }
    *flux = (pm_lane_flux){memory, memory + n, memory + 2 * n, memory + 3 * n};
    return PM_OK;
}

// Copies PM_LANES numbers and notes in `differs` which have changed.
static inline void renew(const double *from, double *to, uint64_t *differs) {
    for (int l = 0; l < PM_LANES; ++l) {
        differs[l] |= bits_of(from[l]) ^ bits_of(to[l]);
        to[l] = from[l];
    }
}

static inline void note(const uint64_t *differs, uint64_t *changed) {
    for (int l = 0; l < PM_LANES; ++l) {
        changed[l] |= differs[l];
    }
}

PM_SIMD_CLONES void pm_lanes_renew(int rows, int lanes, const double *now, double *before,
                                   uint64_t *changed) {
    for (int v = 0; v < lanes; v += PM_LANES) {
        uint64_t differs[PM_LANES] = {0};
        for (int r = 0; r < rows; ++r) {
            const ptrdiff_t at = (ptrdiff_t)r * lanes + v;
            renew(now + at, before + at, differs);
        }
        note(differs, changed + v);
    }
}

PM_SIMD_CLONES void pm_lanes_combine(int rows, int lanes, int count, const double *weight, double h,
                                     const double *z, const double *k, int64_t stride, double *to,
                                     uint64_t *changed) {
    for (int v = 0; v < lanes; v += PM_LANES) {
        uint64_t differs[PM_LANES] = {0};
        for (int r = 0; r < rows; ++r) {
            const ptrdiff_t at = (ptrdiff_t)r * lanes + v;
            double sum[PM_LANES] = {0};
            for (int i = 0; i < count; ++i) {
                for (int l = 0; l < PM_LANES; ++l) {
                    sum[l] += weight[i] * k[i * stride + at + l];
                }
            }
            for (int l = 0; l < PM_LANES; ++l) {
                const double next = z[at + l] + h * sum[l];
                differs[l] |= bits_of(next) ^ bits_of(to[at + l]);
                to[at + l] = next;
            }
        }
        for (int l = 0; l < PM_LANES; ++l) {
            changed[v + l] |= differs[l];
        }
    }
}

// Adds the sums of one co-vector times the rates, and of their magnitudes.
PM_SIMD_CLONES static void book_one(int rows, int lanes, double weight, const double *e,
                                    const double *rate, double *flux, double *gross) {
    for (int v = 0; v < lanes; v += PM_LANES) {
        double sum[PM_LANES] = {0}, magnitude[PM_LANES] = {0};
        for (int r = 0; r < rows; ++r) {
            const ptrdiff_t at = (ptrdiff_t)r * lanes + v;
            for (int l = 0; l < PM_LANES; ++l) {
                const double power = e[at + l] * rate[at + l];
                sum[l] += weight * power;
                magnitude[l] += weight * fabs(power);
            }
        }
        for (int l = 0; l < PM_LANES; ++l) {
            flux[v + l] += sum[l];
            gross[v + l] += magnitude[l];
        }
    }
}

void pm_lanes_book(int rows, int lanes, double weight, const double *e, const double *eta,
                   const double *rate, const pm_lane_flux *flux) {
    if (e != NULL) {
        book_one(rows, lanes, weight, e, rate, flux->energy, flux->energy_gross);
    }
    if (eta != NULL) {
        book_one(rows, lanes, weight, eta, rate, flux->entropy, flux->entropy_gross);
    }
}

// Returns true if the states in PM_LANES lanes are neighbours in their arrays.
static inline bool are_neighbours(const int *first, const int *step) {
    int apart = 0;
    for (int l = 0; l < PM_LANES; ++l) {
        apart |= (first[l] - first[0] - l) | (step[l] - step[0]);
    }
    return apart == 0;
}

// Gathers PM_LANES lanes of states that are neighbours, or anywhere.
PM_SIMD_CLONES static void gather_row(int count, int lanes, const int *component,
                                      const double *from, int step, double *to, uint64_t *differs) {
    for (int c = 0; c < count; ++c) {
        renew(from + (ptrdiff_t)component[c] * step, to + (ptrdiff_t)c * lanes, differs);
    }
}

static void gather_each(int count, int lanes, const int *component, const double *from,
                        const int *first, const int *step, double *to, uint64_t *differs) {
    for (int c = 0; c < count; ++c) {
        double value[PM_LANES];
        for (int l = 0; l < PM_LANES; ++l) {
            value[l] = from[first[l] + (ptrdiff_t)component[c] * step[l]];
        }
        renew(value, to + (ptrdiff_t)c * lanes, differs);
    }
}

void pm_lanes_gather(int count, int lanes, const int *component, const double *from,
                     const int *first, const int *step, double *to, uint64_t *changed) {
    for (int v = 0; v < lanes; v += PM_LANES) {
        uint64_t differs[PM_LANES] = {0};
        if (are_neighbours(first + v, step + v)) {
            gather_row(count, lanes, component, from + first[v], step[v], to + v, differs);
        } else {
            gather_each(count, lanes, component, from, first + v, step + v, to + v, differs);
        }
        if (changed != NULL) {
            note(differs, changed + v);
        }
    }
}

PM_SIMD_CLONES static void note_outside(const pm_group *group, double low, double high, int lanes,
                                        const double *z, uint64_t *outside) {
    const double *x = z + (ptrdiff_t)group->first * lanes;
    for (int v = 0; v < lanes; v += PM_LANES) {
        double value[PM_LANES] = {0};
        for (int c = 0; c < group->size; ++c) {
            for (int l = 0; l < PM_LANES; ++l) {
                const double one = x[(ptrdiff_t)c * lanes + v + l];
                value[l] += one * one;
            }
        }
        for (int l = 0; l < PM_LANES; ++l) {
            const double measure = group->size == 1 ? x[v + l] : sqrt(value[l]);
            outside[v + l] |= (uint64_t)(low > measure) | (uint64_t)(measure > high);
        }
    }
}

void pm_lanes_outside(pm_training_range range, int lanes, const double *z, uint64_t *outside) {
    memset(outside, 0, (size_t)lanes * sizeof *outside);
    for (int i = 0; range.low != NULL && i < range.layout->ngroup; ++i) {
        note_outside(&range.layout->group[i], range.low[i], range.high[i], lanes, z, outside);
    }
}

PM_SIMD_CLONES int pm_lanes_any(int lanes, const uint64_t *changed) {
    uint64_t all = 0;
    for (int l = 0; l < lanes; ++l) {
        all |= changed[l];
    }
    return all != 0;
}

PM_SIMD_CLONES int pm_lanes_any_not_finite(int64_t count, const double *x) {
    uint64_t any = 0;
    for (int64_t i = 0; i < count; ++i) {
        const uint64_t magnitude = bits_of(x[i]) & 0x7fffffffffffffffu;
        any |= (uint64_t)(magnitude >= 0x7ff0000000000000u);
    }
    return any != 0;
}
