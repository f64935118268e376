// The numbers of PM_LANES lanes are one vector, which the compiler splits into as many registers as
// the processor's instruction set needs.
#include "sim/lanes.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "base/linalg.h"
#include "base/simd.h"

// A number, or the bits of a number, of each of PM_LANES lanes.
typedef double vector __attribute__((vector_size(PM_LANES * sizeof(double))));
typedef uint64_t bits __attribute__((vector_size(PM_LANES * sizeof(uint64_t))));

#define SIGN ((uint64_t)1 << 63)

static inline void load(vector *x, const double *from) {
    memcpy(x, from, sizeof *x);
}

static inline void store(const vector *x, double *to) {
    memcpy(to, x, sizeof *x);
}

static inline uint64_t bits_of(double x) {
    uint64_t result;
    memcpy(&result, &x, sizeof result);
    return result;
}

pm_status pm_lane_flux_new(pm_lane_flux *flux, pm_arena *arena, int lanes) {
    double *memory = pm_arena_array(arena, 4 * (size_t)lanes, sizeof *memory);
    const ptrdiff_t n = lanes;
    PM_TRY(pm_allocated(memory, "the fluxes of %d lanes", lanes));
    *flux = (pm_lane_flux){memory, memory + n, memory + 2 * n, memory + 3 * n};
    return PM_OK;
}

// Sets bit `row` % 64 of `renewed` in the lanes in which two numbers differ.
static inline void note(int row, const vector *now, const vector *before, bits *renewed) {
    *renewed |= (bits)((bits)*now != (bits)*before) & ((uint64_t)1 << (row & 63));
}

bool pm_renew(double *to, const double *from, int n) {
    const size_t size = (size_t)n * sizeof *to;
    if (to == NULL || from == NULL || memcmp(to, from, size) == 0) {
        return false;
    }
    memcpy(to, from, size);
    return true;
}

// Replaces row `row` of a single lane. Returns its bit if the number has got other bits.
static inline uint64_t renew_one(int row, double now, double before, double *to) {
    *to = now;
    return (uint64_t)(bits_of(now) != bits_of(before)) << (row & 63);
}

PM_SIMD_CLONES void pm_lanes_renew(int rows, int lanes, const double *now, double *before,
                                   uint64_t *renewed) {
    *renewed = 0;
    for (int r = 0; r < rows && lanes == 1; ++r) {
        *renewed |= renew_one(r, now[r], before[r], &before[r]);
    }
    for (int v = 0; v < lanes && lanes > 1; v += PM_LANES) {
        bits mask = {0};
        for (int r = 0; r < rows; ++r) {
            const ptrdiff_t at = (ptrdiff_t)r * lanes + v;
            vector a, b;
            load(&a, now + at);
            load(&b, before + at);
            note(r, &a, &b, &mask);
            store(&a, before + at);
        }
        memcpy(renewed + v, &mask, sizeof mask);
    }
}

PM_SIMD_CLONES void pm_lanes_combine(int rows, int lanes, int count, const double *weight, double h,
                                     const double *z, const double *k, int64_t stride,
                                     const double *before, double *to, uint64_t *renewed) {
    *renewed = 0;
    for (int r = 0; r < rows && lanes == 1; ++r) {
        double sum = 0;
        for (int i = 0; i < count; ++i) {
            sum += weight[i] * k[i * stride + r];
        }
        *renewed |= renew_one(r, z[r] + h * sum, before[r], &to[r]);
    }
    for (int v = 0; v < lanes && lanes > 1; v += PM_LANES) {
        bits mask = {0};
        for (int r = 0; r < rows; ++r) {
            const ptrdiff_t at = (ptrdiff_t)r * lanes + v;
            vector sum = {0}, rate, next, old;
            for (int i = 0; i < count; ++i) {
                load(&rate, k + i * stride + at);
                sum += weight[i] * rate;
            }
            load(&next, z + at);
            next += h * sum;
            load(&old, before + at);
            note(r, &next, &old, &mask);
            store(&next, to + at);
        }
        memcpy(renewed + v, &mask, sizeof mask);
    }
}

// Adds the sums of one co-vector times the rates, and of their magnitudes.
PM_SIMD_CLONES static void book_one(int rows, int lanes, double weight, bool anew, const double *e,
                                    const double *rate, double *flux, double *gross) {
    if (lanes == 1) {
        double sum = 0, magnitude = 0;
        for (int r = 0; r < rows; ++r) {
            const double term = weight * (e[r] * rate[r]);
            sum += term;
            magnitude += fabs(term);
        }
        *flux = (anew ? 0 : *flux) + sum;
        *gross = (anew ? 0 : *gross) + magnitude;
        return;
    }
    for (int v = 0; v < lanes; v += PM_LANES) {
        vector sum = {0}, magnitude = {0}, net = {0}, all = {0}, a, b;
        for (int r = 0; r < rows; ++r) {
            const ptrdiff_t at = (ptrdiff_t)r * lanes + v;
            load(&a, e + at);
            load(&b, rate + at);
            a = weight * (a * b);
            sum += a;
            magnitude += (vector)((bits)a & ~SIGN);
        }
        if (!anew) {
            load(&net, flux + v);
            load(&all, gross + v);
        }
        net += sum;
        all += magnitude;
        store(&net, flux + v);
        store(&all, gross + v);
    }
}

void pm_lanes_book(int rows, int lanes, double weight, bool anew, const double *e,
                   const double *eta, const double *rate, const pm_lane_flux *flux) {
    book_one(rows, lanes, weight, anew, e, rate, flux->energy, flux->energy_gross);
    if (eta != NULL) {
        book_one(rows, lanes, weight, anew, eta, rate, flux->entropy, flux->entropy_gross);
    }
}

// --- items that lanes refer to ---

void pm_lanes_note_rows(int lanes, const pm_lane_places *places, pm_lane_row *row) {
    for (int v = 0; v < lanes; v += PM_LANES) {
        const int *first = places->first + v, *step = places->step + v, *lane = places->lane + v;
        int apart = 0;
        for (int l = 0; l < PM_LANES; ++l) {
            apart |= (first[l] - first[0] - l) | (step[l] - step[0]) | (lane[l] - lane[0] - l);
        }
        row[v / PM_LANES] = (pm_lane_row){first[0], step[0], lane[0], apart == 0};
    }
}

PM_SIMD_CLONES void pm_lanes_gather_block(int count, int lanes, const int *component,
                                          const pm_lane_places *places, const double *from,
                                          double *to) {
    for (int v = 0; v < lanes; v += PM_LANES) {
        const pm_lane_row row = places->row[v / PM_LANES];
        for (int c = 0; c < count; ++c) {
            double *at = to + (ptrdiff_t)c * lanes + v;
            if (row.neighbours) {
                memcpy(at, from + row.first + (ptrdiff_t)component[c] * row.step,
                       PM_LANES * sizeof *at);
                continue;
            }
            for (int l = v; l < v + PM_LANES; ++l) {
                at[l - v] = from[places->first[l] + (ptrdiff_t)component[c] * places->step[l]];
            }
        }
    }
}

PM_SIMD_CLONES void pm_lanes_gather_renewed_block(int lanes, const pm_lane_places *places,
                                                  const uint64_t *from, uint64_t wanted,
                                                  uint64_t *renewed) {
    for (int v = 0; v < lanes; v += PM_LANES) {
        const pm_lane_row row = places->row[v / PM_LANES];
        for (int l = 0; l < PM_LANES; ++l) {
            const int lane = row.neighbours ? row.lane + l : places->lane[v + l];
            renewed[v + l] |= from[lane] & wanted;
        }
    }
}

PM_SIMD_CLONES void pm_lanes_add(int count, int lanes, const int *component,
                                 const pm_lane_places *places, int begin, int end,
                                 const double *rate, double *to) {
    for (int l = begin; l < end;) {
        const pm_lane_row row = lanes == 1 ? (pm_lane_row){0} : places->row[l / PM_LANES];
        if (row.neighbours && l % PM_LANES == 0 && l + PM_LANES <= end) {
            for (int c = 0; c < count; ++c) {
                double *at = to + row.first + (ptrdiff_t)component[c] * row.step;
                vector sum, term;
                load(&sum, at);
                load(&term, rate + (ptrdiff_t)c * lanes + l);
                sum += term;
                store(&sum, at);
            }
            l += PM_LANES;
            continue;
        }
        for (int c = 0; c < count; ++c) {
            to[places->first[l] + (ptrdiff_t)component[c] * places->step[l]] +=
                rate[(ptrdiff_t)c * lanes + l];
        }
        ++l;
    }
}

// --- checks ---

PM_SIMD_CLONES static void note_out_of_range(const pm_group *group, double low, double high,
                                             int lanes, const double *z, uint64_t *outside) {
    const double *x = z + (ptrdiff_t)group->first * lanes;
    const double slack = group->size > 1 ? PM_RANGE_SLACK * high : 0;
    if (lanes == 1) {
        double sum = 0;
        for (int c = 0; c < group->size; ++c) {
            sum += x[c] * x[c];
        }
        const double size = group->size > 1 ? sqrt(sum) : x[0];
        outside[0] |= low - size > slack || size - high > slack;
        return;
    }
    for (int v = 0; v < lanes; v += PM_LANES) {
        vector square = {0}, measure;
        bits before;
        load(&measure, x + v);
        for (int c = 0; c < group->size && group->size > 1; ++c) {
            vector one;
            load(&one, x + (ptrdiff_t)c * lanes + v);
            square += one * one;
        }
        for (int l = 0; l < PM_LANES && group->size > 1; ++l) {
            measure[l] = sqrt(square[l]);
        }
        memcpy(&before, outside + v, sizeof before);
        before |= ((bits)(low - measure > slack) | (bits)(measure - high > slack)) & 1;
        memcpy(outside + v, &before, sizeof before);
    }
}

void pm_lanes_outside(pm_training_range range, int lanes, const double *z, uint64_t *outside) {
    memset(outside, 0, (size_t)lanes * sizeof *outside);
    for (int i = 0; range.low != NULL && i < range.layout->ngroup; ++i) {
        note_out_of_range(&range.layout->group[i], range.low[i], range.high[i], lanes, z, outside);
    }
}

PM_SIMD_CLONES int pm_lanes_any_block(int lanes, const uint64_t *x) {
    uint64_t any = 0;
    for (int l = 0; l < lanes; ++l) {
        any |= x[l];
    }
    return any != 0;
}

PM_SIMD_CLONES int pm_lanes_all_block(int lanes, const uint64_t *x) {
    uint64_t zeros = 0;
    for (int l = 0; l < lanes; ++l) {
        zeros |= (uint64_t)(x[l] == 0);
    }
    return zeros == 0;
}

PM_SIMD_CLONES int pm_lanes_any_not_finite(int64_t count, const double *x) {
    uint64_t any = 0;
    for (int64_t i = 0; i < count; ++i) {
        const uint64_t magnitude = bits_of(x[i]) & 0x7fffffffffffffffu;
        any |= (uint64_t)(magnitude >= 0x7ff0000000000000u);
    }
    return any != 0;
}

// Loads up to PM_LANES numbers; the rest are zeros, as are all if `from` is NULL.
static inline void load_some(vector *x, const double *from, int at, int count) {
    const int left = count - at;
    if (from != NULL && left >= PM_LANES) {
        memcpy(x, from + at, sizeof *x);
        return;
    }
    *x = (vector){0};
    if (from != NULL) {
        memcpy(x, from + at, (size_t)left * sizeof *from);
    }
}

// Replaces the numbers of `most` by those of `x` that are larger.
static inline void keep_larger(vector *most, const vector *x) {
    const bits larger = (bits)(*x > *most);
    *most = (vector)(((bits)*x & larger) | ((bits)*most & ~larger));
}

static inline bool is_any(const bits *x) {
    uint64_t any = 0;
    for (int l = 0; l < PM_LANES; ++l) {
        any |= (*x)[l];
    }
    return any != 0;
}

static double largest_of(const vector *x) {
    double largest = 0;
    for (int l = 0; l < PM_LANES; ++l) {
        largest = (*x)[l] > largest ? (*x)[l] : largest;
    }
    return largest;
}

PM_SIMD_CLONES double pm_lanes_largest(int count, const double *x) {
    vector most = {0}, some;
    for (int i = 0; i < count; i += PM_LANES) {
        load_some(&some, x, i, count);
        keep_larger(&most, &some);
    }
    return largest_of(&most);
}

PM_SIMD_CLONES void pm_lanes_worst(int lanes, bool magnitude, const double *a, const double *b,
                                   const double *gross_a, const double *gross_b, int nclass,
                                   const double *least, double *worst) {
    vector most[PM_LANES_CLASSES] = {{0}};
    bits lower = {0}; // whether a lane counts, but not in the first class
    for (int i = 0; i < lanes; i += PM_LANES) {
        vector sum, gross, other;
        load_some(&sum, a, i, lanes);
        load_some(&other, b, i, lanes);
        sum += other;
        load_some(&gross, gross_a, i, lanes);
        load_some(&other, gross_b, i, lanes);
        keep_larger(&gross, &other);
        const vector residual = (magnitude ? (vector)((bits)sum & ~SIGN) : -sum) / gross;
        const bits first = (bits)(gross >= least[0]);
        lower |= (bits)(gross >= least[nclass - 1]) & ~first;
        const vector counted = (vector)((bits)residual & first);
        keep_larger(&most[0], &counted);
        for (int k = 1; k < nclass && is_any(&lower); ++k) {
            const vector more = (vector)((bits)residual & (bits)(gross >= least[k]));
            keep_larger(&most[k], &more);
        }
    }
    // Lanes before the first one that is not in the first class have been counted there alone.
    for (int k = 0; k < nclass; ++k) {
        const double own = largest_of(&most[k]);
        worst[k] = k > 0 && worst[k - 1] > own ? worst[k - 1] : own;
    }
}
