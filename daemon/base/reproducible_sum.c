// Pieces of numbers are multiples of 2^(26 k): a piece has at most 25 bits and a sign, and 2^26 of
// them fit into the 53 bits of a double.
#include "base/reproducible_sum.h"

#include <math.h>
#include <string.h>

#include "base/simd.h"

#define PIECE_BITS 26
#define MIDDLE 40 // number of the piece of ones
#define LEAST 5   // the smallest top piece: pieces below would be subnormal
#define MOST 75   // the largest one: larger pieces would overflow
#define LANES 8   // numbers that are split at a time
#define PARTS 3   // of a sum
#define MAGNITUDE (~((uint64_t)1 << 63))

typedef double vector __attribute__((vector_size(LANES * sizeof(double))));
typedef int64_t bits __attribute__((vector_size(LANES * sizeof(int64_t))));

// Loads up to LANES numbers; the rest are zeros.
static inline void load(vector *x, const double *from, int64_t left) {
    if (left >= LANES) {
        memcpy(x, from, sizeof *x);
    } else {
        *x = (vector){0};
        memcpy(x, from, (size_t)left * sizeof *from);
    }
}

// Returns the largest magnitude. A number that is not finite counts as larger than all others.
PM_SIMD_CLONES static double largest(int64_t count, const double *x) {
    bits most = {0};
    for (int64_t i = 0; i < count; i += LANES) {
        vector v;
        load(&v, x + i, count - i);
        const bits magnitude = (bits)v & (int64_t)MAGNITUDE;
        const bits larger = magnitude > most;
        most = (magnitude & larger) | (most & ~larger);
    }
    int64_t result = 0;
    for (int l = 0; l < LANES; ++l) {
        result = most[l] > result ? most[l] : result;
    }
    double value;
    memcpy(&value, &result, sizeof value);
    return value;
}

// Adds the pieces of x to part [PARTS]. Adding `rounder` to a number and subtracting it again
// rounds the number to a multiple of a piece.
PM_SIMD_CLONES static void split(int64_t count, const double *x, bool magnitudes,
                                 const double *rounder, double *part) {
    vector sum[PARTS] = {{0}};
    const int64_t mask = magnitudes ? (int64_t)MAGNITUDE : -1;
    for (int64_t i = 0; i < count; i += LANES) {
        vector rest;
        load(&rest, x + i, count - i);
        rest = (vector)((bits)rest & mask);
        for (int k = 0; k < PARTS; ++k) {
            const vector piece = (rest + rounder[k]) - rounder[k];
            sum[k] += piece;
            rest -= piece;
        }
    }
    for (int k = 0; k < PARTS; ++k) {
        for (int l = 0; l < LANES; ++l) {
            part[k] += sum[k][l];
        }
    }
}

// Makes `top` the first piece of the sum, if it is not below it.
static void raise(pm_reproducible_sum *sum, double top) {
    for (; sum->top > 0 && sum->top < top; sum->top += 1) {
        sum->part[2] = sum->part[1];
        sum->part[1] = sum->part[0];
        sum->part[0] = 0;
        if (top - sum->top > PARTS) {
            sum->part[1] = sum->part[2] = 0;
            sum->top = top - 1;
        }
    }
    sum->top = sum->top == 0 ? top : sum->top;
}

void pm_reproducible_sum_add(pm_reproducible_sum *sum, int64_t count, const double *x,
                             bool magnitudes) {
    const double most = largest(count, x);
    if (most == 0) {
        return;
    }
    // The first piece in which a number of this magnitude is not zero: the piece k rounds numbers
    // below half its unit to zero.
    int exponent, top = MOST;
    if (isfinite(most)) {
        frexp(most, &exponent); // most < 2^exponent
        const int steps = exponent + PIECE_BITS * MIDDLE;
        top = steps > 0 ? steps / PIECE_BITS : 0;
        top = top < LEAST ? LEAST : top > MOST ? MOST : top;
    }
    raise(sum, top);
    double rounder[PARTS];
    for (int k = 0; k < PARTS; ++k) {
        rounder[k] =
            0x1.8p52 * ldexp(1, PIECE_BITS * ((int)sum->top - k - MIDDLE)); // times its unit
    }
    split(count, x, magnitudes, rounder, sum->part);
}

void pm_reproducible_sum_merge(pm_reproducible_sum *sum, const pm_reproducible_sum *other) {
    if (other->top == 0) {
        return;
    }
    raise(sum, other->top);
    for (int k = 0; k < PARTS; ++k) {
        const double piece = sum->top - k; // its place in the other sum is other->top - piece
        const double at = other->top - piece;
        sum->part[k] += at >= 0 && at < PARTS ? other->part[(int)at] : 0;
    }
}

double pm_reproducible_sum_value(const pm_reproducible_sum *sum) {
    return sum->part[0] + (sum->part[1] + sum->part[2]);
}
