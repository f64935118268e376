// Regressions of the rates of momenta that show skew couplings.
#include "propose/gyration.h"

#include <math.h>
#include <string.h>

#define GYROSCOPIC 1e-2 // fraction of the variance that such a coupling must explain
#define OPPOSITE 0.1    // symmetric part over skew part of opposite coefficients at most

// One component of a group as a group of its own.
static pm_look_group component_of(const pm_look_group *g, const pm_group *scalar, int component) {
    pm_look_group c = *g;
    c.group = scalar;
    c.first = g->first + component;
    return c;
}

// Regression of the rate of component `c` of a momentum on all components of the pair. Writes the
// coefficients of the momentum [size], and returns how much the other components explain.
static double explain_component(const pm_look *look, const pm_look_group *position,
                                const pm_look_group *momentum, int c, double *of_momentum) {
    const int size = momentum->group->size;
    const pm_group scalar = {.size = 1};
    const pm_look_group target = component_of(momentum, &scalar, c);
    pm_look_group source[PM_LOOK_SOURCES];
    double coefficient[PM_LOOK_SOURCES];
    int count = 0;
    for (int k = 0; k < size; ++k) {
        source[count++] = component_of(position, &scalar, k);
    }
    source[count++] = target;
    const double without = pm_look_explain(look, &target, count, source, coefficient);
    --count;
    for (int k = 0; k < size; ++k) {
        source[count++] = component_of(momentum, &scalar, k);
    }
    const double rest = pm_look_explain(look, &target, count, source, coefficient);
    memcpy(of_momentum, coefficient + size, (size_t)size * sizeof *of_momentum);
    return without - rest;
}

bool pm_look_gyroscopic(const pm_look *look, const pm_look_group *position,
                        const pm_look_group *momentum) {
    enum { MOST = PM_LOOK_SOURCES / 2 };
    const int size = momentum->group->size;
    double matrix[MOST][MOST], gain[MOST];
    for (int c = 0; c < size && size <= MOST; ++c) {
        gain[c] = explain_component(look, position, momentum, c, matrix[c]);
    }
    for (int c = 0; c < size && size <= MOST; ++c) {
        for (int k = 0; k < c; ++k) {
            const double symmetric = fabs(matrix[c][k] + matrix[k][c]);
            const double skew = fabs(matrix[c][k] - matrix[k][c]);
            if (symmetric < OPPOSITE * skew && fmin(gain[c], gain[k]) > GYROSCOPIC) {
                return true;
            }
        }
    }
    return false;
}

// Returns how much more of the rate of `target` is explained when `driver` is added to `target`
// itself and `position`; *coefficient is that of `driver`.
static double explain_driver(const pm_look *look, const pm_look_group *target,
                             const pm_look_group *position, const pm_look_group *driver,
                             double *coefficient) {
    const pm_look_group source[3] = {*target, *position, *driver};
    double value[3];
    const double without = pm_look_explain(look, target, 2, source, value);
    const double rest = pm_look_explain(look, target, 3, source, value);
    *coefficient = value[2];
    return without - rest;
}

bool pm_look_gyrates(const pm_look *look, const pm_look_group *position,
                     const pm_look_group *momentum, const pm_look_group *other) {
    double of_other, of_momentum;
    return explain_driver(look, momentum, position, other, &of_other) > GYROSCOPIC &&
           explain_driver(look, other, position, momentum, &of_momentum) > GYROSCOPIC &&
           of_other * of_momentum < 0;
}
