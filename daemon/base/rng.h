// Random numbers from an explicit seed: xoshiro256** seeded by splitmix64
// (Blackman and Vigna, ACM Trans. Math. Softw. 47, 2021). Same seed, same numbers, everywhere.
#ifndef PM_BASE_RNG_H
#define PM_BASE_RNG_H

#include <stdint.h>

typedef struct pm_rng {
    uint64_t state[4];
} pm_rng;

// Storage the caller owns. Different `stream`s of one seed are independent sequences.
void pm_rng_init(pm_rng *rng, uint64_t seed, uint64_t stream);

uint64_t pm_rng_bits(pm_rng *rng);

// Uniform in [0, 1), with 53 random bits.
double pm_rng_uniform(pm_rng *rng);

// Normal with mean 0 and standard deviation 1 (Box-Muller).
double pm_rng_normal(pm_rng *rng);

// Uniform integer in [0, n), n > 0.
uint64_t pm_rng_below(pm_rng *rng, uint64_t n);

#endif
