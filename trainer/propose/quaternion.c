// The angular velocity that moves a quaternion, and its regression on an angular momentum.
#include "propose/quaternion.h"

#include "propose/least_squares.h"

#define UPRIGHT 0.02    // relative to |q||q'|: largest part of the rate along the quaternion
#define UNEXPLAINED 0.1 // of the variance of the angular velocity, at most
#define TERMS 4         // of a regression: three components and a constant

// Returns the position of part `i` of a quaternion, whose scalar part is part 0.
static int place_of(pm_quaternion order, int part) {
    return !order.scalar_last ? part : (part + 3) % 4;
}

int pm_quaternion_term(pm_quaternion order, int row, int axis, int *column) {
    const int part = order.scalar_last ? (row + 1) % 4 : row;
    if (part == 0) { // q0' = -(q1 w1 + q2 w2 + q3 w3)/2
        *column = place_of(order, 1 + axis);
        return -1;
    }
    if (part - 1 == axis) {
        *column = place_of(order, 0);
        return 1;
    }
    // The product of vectors is q x w from the body, and w x q from outside.
    const int other = 3 - (part - 1) - axis;
    const bool ascends = (other + 1) % 3 == axis;
    *column = place_of(order, 1 + other);
    return ascends ? order.turns : -order.turns;
}

// Computes w [3] of one state, for the rate `rate` [4] of q [4].
static void velocity_of(pm_quaternion order, const double *q, const double *rate, double *w) {
    const double square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    for (int axis = 0; axis < 3; ++axis) {
        w[axis] = 0;
        for (int row = 0; row < 4; ++row) {
            int column;
            const int sign = pm_quaternion_term(order, row, axis, &column);
            w[axis] += 2 * sign * q[column] * rate[row] / square;
        }
    }
}

// Writes an angular momentum m [3] as the body sees it. If it is seen from outside, the rate that
// it would cause as an angular velocity is also caused by its components in the body.
static void see_from_body(pm_quaternion order, const double *q, const double *m, double *seen) {
    const pm_quaternion body = {1, order.scalar_last};
    double rate[4] = {0};
    for (int row = 0; row < 4; ++row) {
        for (int axis = 0; axis < 3; ++axis) {
            int column;
            const int sign = pm_quaternion_term(order, row, axis, &column);
            rate[row] += sign * q[column] * m[axis] / 2;
        }
    }
    velocity_of(body, q, rate, seen);
}

// Returns the fraction of the variance of w that a linear function of the angular momentum leaves,
// both as the body sees them; 1 if they point in opposite directions.
static double unexplained(const pm_look *look, pm_quaternion order, const pm_look_group *target,
                          const pm_look_group *spin) {
    const pm_quaternion body = {1, order.scalar_last};
    pm_least_squares sums[3] = {{.n = TERMS}, {.n = TERMS}, {.n = TERMS}};
    double mean[3] = {0}, along = 0, rest = 0, all = 0;
    for (int k = 0; k < look->count; ++k) {
        const double *z = look->z + (ptrdiff_t)k * look->scene->nz;
        const double *rate = look->rate + (ptrdiff_t)k * look->scene->nz + target->first;
        double w[3], m[3];
        velocity_of(body, z + target->first, rate, w);
        see_from_body(order, z + target->first, z + spin->first, m);
        const double term[TERMS] = {m[0], m[1], m[2], spin->deviation};
        for (int c = 0; c < 3; ++c) {
            pm_least_squares_add(&sums[c], term, w[c]);
            mean[c] += w[c] / look->count;
            along += w[c] * m[c];
        }
    }
    for (int c = 0; c < 3; ++c) {
        double solution[TERMS];
        const double square = sums[c].square;
        rest += square * pm_least_squares_solve(&sums[c], solution);
        all += square - look->count * mean[c] * mean[c];
    }
    return all > 0 && along > 0 ? rest / all : 1;
}

static bool keeps_length(const pm_look *look, const pm_look_group *target) {
    double along = 0, size = 0;
    for (int k = 0; k < look->count; ++k) {
        const ptrdiff_t at = (ptrdiff_t)k * look->scene->nz + target->first;
        double product = 0, q = 0, rate = 0;
        for (int c = 0; c < 4; ++c) {
            product += look->z[at + c] * look->rate[at + c];
            q += look->z[at + c] * look->z[at + c];
            rate += look->rate[at + c] * look->rate[at + c];
        }
        along += product * product;
        size += q * rate;
    }
    return along < UPRIGHT * UPRIGHT * size;
}

pm_quaternion pm_look_at_quaternion(const pm_look *look, const pm_look_group *target,
                                    const pm_look_group *spin) {
    pm_quaternion best = {0};
    double least = UNEXPLAINED;
    for (int k = 0; k < 4 && keeps_length(look, target); ++k) {
        const pm_quaternion order = {k % 2 == 0 ? 1 : -1, k / 2 == 1};
        const double rest = unexplained(look, order, target, spin);
        if (rest < least) {
            least = rest;
            best = order;
        }
    }
    return best;
}
