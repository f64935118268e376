// Random numbers from an explicit seed, by xoshiro256** seeded with splitmix64 (Blackman and Vigna,
// ACM Trans. Math. Softw. 47, 2021). The same seed gives the same bits on every machine; only
// pm_rng_normal also depends on the C library's log and cos.
#ifndef PM_BASE_RNG_H
#define PM_BASE_RNG_H

#include <stdint.h>

// The caller owns the storage.
typedef struct pm_rng {
    uint64_t state[4];
} pm_rng;

// Starts a sequence. Different streams of one seed are independent sequences.
void pm_rng_init(pm_rng *rng, uint64_t seed, uint64_t stream);

// Returns 64 random bits.
uint64_t pm_rng_bits(pm_rng *rng);

// Returns a number uniform in [0, 1), with 53 random bits.
double pm_rng_uniform(pm_rng *rng);

// Returns a normal number with mean 0 and standard deviation 1, by the method of Box and Muller.
double pm_rng_normal(pm_rng *rng);

// Returns a whole number uniform in [0, n), n > 0.
uint64_t pm_rng_below(pm_rng *rng, uint64_t n);

#endif
