// Newton's method in the two directions dE and dS, in the metric of the step.
#include "sim/invariant_projection.h"

#include <float.h>
#include <math.h>
#include <stddef.h>

// A residual below this many units of DBL_EPSILON times the gross value is rounding alone.
#define ROUNDING 4
// Squared sine of the angle between the two gradients below which they count as parallel.
#define SMALLEST_ANGLE 1e-12

void pm_invariant_projection_start(pm_invariant_projection *projection, double E, double S) {
    *projection = (pm_invariant_projection){E, fabs(E), S, fabs(S)};
}

static void add(double *sum, double *gross, double weight, int n, const double *covector,
                const double *k) {
    double value = 0, magnitude = 0;
    for (int i = 0; covector != NULL && i < n; ++i) {
        value += covector[i] * k[i];
        magnitude += fabs(covector[i] * k[i]);
    }
    *sum += weight * value;
    *gross += weight * magnitude;
}

void pm_invariant_projection_book(pm_invariant_projection *projection, bool first, double weight,
                                  int n, const double *dE, const double *dS, const double *k) {
    if (first) {
        pm_invariant_projection_start(projection, projection->energy, projection->entropy);
    }
    add(&projection->energy, &projection->energy_gross, weight, n, dE, k);
    add(&projection->entropy, &projection->entropy_gross, weight, n, dS, k);
}

// Returns wanted - is, or 0 if the difference is rounding.
static double missing(double wanted, double is, double gross) {
    const double difference = wanted - is;
    return fabs(difference) > ROUNDING * DBL_EPSILON * gross ? difference : 0;
}

// Returns the squared distance that a group has moved.
static double moved(const pm_group *group, const double *from, const double *to) {
    double sum = 0;
    for (int c = group->first; c < group->first + group->size; ++c) {
        sum += (to[c] - from[c]) * (to[c] - from[c]);
    }
    return sum;
}

// Inner products of the gradients in the metric of the step.
typedef struct products {
    double EE, ES, SS;
} products;

static products products_of(const pm_layout *layout, const double *start, const double *z,
                            const double *dE, const double *dS) {
    products sum = {0, 0, 0};
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        const double square = moved(group, start, z);
        for (int c = group->first; c < group->first + group->size; ++c) {
            const double S = dS == NULL ? 0 : dS[c];
            sum.EE += square * dE[c] * dE[c];
            sum.ES += square * dE[c] * S;
            sum.SS += square * S * S;
        }
    }
    return sum;
}

// Finds the move along dE and dS, each times the metric, that changes energy and entropy by the
// given amounts. False if there is none as short as the step itself.
static bool solve(const products *p, double energy, double entropy, double *along_E,
                  double *along_S) {
    // The part of dE along which the entropy does not change.
    const double slope = p->SS > 0 ? p->ES / p->SS : 0;
    const double free = p->EE - slope * p->ES;
    if (!(free > SMALLEST_ANGLE * p->EE)) {
        return false;
    }
    *along_E = p->SS > 0 ? (energy - slope * entropy) / free : energy / free;
    *along_S = p->SS > 0 ? entropy / p->SS - slope * *along_E : 0;
    const double square =
        *along_E * *along_E * p->EE + 2 * *along_E * *along_S * p->ES + *along_S * *along_S * p->SS;
    return square <= 1;
}

bool pm_invariant_projection_newton_step(pm_invariant_projection *projection,
                                         const pm_layout *layout, const double *start, double E,
                                         double S, const double *dE, const double *dS, double *z) {
    const double energy = missing(projection->energy, E, projection->energy_gross);
    const double entropy = missing(projection->entropy, S, projection->entropy_gross);
    if (dE == NULL || (energy == 0 && entropy == 0)) {
        return false;
    }
    const products p = products_of(layout, start, z, dE, dS);
    double along_E = 0, along_S = 0;
    if (!solve(&p, energy, entropy, &along_E, &along_S)) {
        pm_invariant_projection_start(projection, E, S);
        return false;
    }
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        const double square = moved(group, start, z);
        for (int c = group->first; c < group->first + group->size; ++c) {
            z[c] += square * (along_E * dE[c] + (dS == NULL ? 0 : along_S * dS[c]));
        }
    }
    return true;
}
