// xoshiro256** seeded by splitmix64.
#include "base/rng.h"

#include <math.h>

static uint64_t rotate_left(uint64_t x, int k) {
    return (x << k) | (x >> (64 - k));
}

void pm_rng_init(pm_rng *rng, uint64_t seed, uint64_t stream) {
    uint64_t state = seed ^ (stream * 0xd1342543de82ef95u);
    for (int i = 0; i < 4; ++i) {
        uint64_t x = state += 0x9e3779b97f4a7c15u;
        x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
        x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
        rng->state[i] = x ^ (x >> 31);
    }
}

uint64_t pm_rng_bits(pm_rng *rng) {
    uint64_t *s = rng->state;
    const uint64_t result = rotate_left(s[1] * 5, 7) * 9;
    const uint64_t t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = rotate_left(s[3], 45);
    return result;
}

double pm_rng_uniform(pm_rng *rng) {
    return (double)(pm_rng_bits(rng) >> 11) * 0x1.0p-53;
}

double pm_rng_normal(pm_rng *rng) {
    const double two_pi = 6.283185307179586;
    // 1 - u lies in (0, 1], so the logarithm is finite.
    const double radius = sqrt(-2.0 * log(1.0 - pm_rng_uniform(rng)));
    return radius * cos(two_pi * pm_rng_uniform(rng));
}

uint64_t pm_rng_below(pm_rng *rng, uint64_t n) {
    // Numbers beyond the last multiple of n are rejected, which keeps the result uniform.
    const uint64_t limit = UINT64_MAX - UINT64_MAX % n;
    uint64_t x = pm_rng_bits(rng);
    while (x >= limit) {
        x = pm_rng_bits(rng);
    }
    return x % n;
}
