// Probabilities in proportion to size, with a limit of 1, and systematic sampling (Madow, Ann.
// Math. Stat. 20 (1949) 333).
#include "optimise/importance.h"

#include <math.h>
#include <stdbool.h>

// The part of the probability that is equal for all samples. The weight of a sample is then at most
// twice that of a uniform batch.
#define EQUAL 0.5
// Samples whose probability reaches 1 leave more for others, some of which reach 1 then.
#define MOST_ROUNDS 20

void pm_importance_chances(int count, double *share, int wanted) {
    double total = 0;
    for (int i = 0; i < count; ++i) {
        total += share[i];
    }
    for (int i = 0; i < count; ++i) {
        share[i] = total > 0 ? EQUAL / count + (1 - EQUAL) * share[i] / total : 1.0 / count;
    }
    double factor = wanted;
    for (int round = 0; round < MOST_ROUNDS; ++round) {
        double rest = 0;
        int certain = 0;
        for (int i = 0; i < count; ++i) {
            const bool full = factor * share[i] >= 1;
            certain += full;
            rest += full ? 0 : share[i];
        }
        const double next = rest > 0 ? (wanted - certain) / rest : factor;
        if (next <= factor * (1 + 1e-12)) {
            break;
        }
        factor = next;
    }
    for (int i = 0; i < count; ++i) {
        share[i] = fmin(factor * share[i], 1);
    }
}

int pm_importance_choose(int count, const double *chance, int wanted, double uniform, int *chosen) {
    double sum = uniform;
    int n = 0;
    for (int i = 0; i < count && n <= wanted; ++i) {
        const double next = sum + chance[i];
        if (floor(next) > floor(sum)) {
            chosen[n++] = i;
        }
        sum = next;
    }
    return n;
}
