// The table of integrators: the coefficients of each method, with their source.
#include "scene/integrator.h"

#include <stddef.h>
#include <string.h>

#define EULER .nstage = 1, .order = 1, .a = {{0}}, .b = {1}

// The embedded method is Euler's.
#define HEUN                                                                  \
    .nstage = 2, .order = 2, .a = {{0}, {1}}, .b = {0.5, 0.5}, .embedded = 1, \
    .error_weights = {-0.5, 0.5}

// Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, table II.1.2. The embedded
// method is the midpoint rule of its second stage.
#define RK4                                                          \
    .nstage = 4, .order = 4, .a = {{0}, {0.5}, {0, 0.5}, {0, 0, 1}}, \
    .b = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}, .embedded = 2,        \
    .error_weights = {1.0 / 6, -2.0 / 3, 1.0 / 3, 1.0 / 6}

#define SQRT5 2.23606797749978969641

// Butcher, Numerical Methods for Ordinary Differential Equations (2016), section 326. Its abscissae
// are those of Lobatto's quadrature, so that no weight is negative.
#define RK6                                                                            \
    .nstage = 7, .order = 6,                                                           \
    .a = {{0},                                                                         \
          {(5 - SQRT5) / 10},                                                          \
          {-SQRT5 / 10, (5 + 2 * SQRT5) / 10},                                         \
          {(-15 + 7 * SQRT5) / 20, (-1 + SQRT5) / 4, (15 - 7 * SQRT5) / 10},           \
          {(5 - SQRT5) / 60, 0, 1.0 / 6, (15 + 7 * SQRT5) / 60},                       \
          {(5 + SQRT5) / 60, 0, (9 - 5 * SQRT5) / 12, 1.0 / 6, (-5 + 3 * SQRT5) / 10}, \
          {1.0 / 6, 0, (-55 + 25 * SQRT5) / 12, (-25 - 7 * SQRT5) / 12, 5 - 2 * SQRT5, \
           (5 + SQRT5) / 2}},                                                          \
    .b = {1.0 / 12, 0, 0, 0, 5.0 / 12, 5.0 / 12, 1.0 / 12}

// Discrete gradients (Gonzalez 1996; for thermoelastic systems Romero, Int. J. Numer. Meth. Engng
// 79 (2009) 706). The implicit equation is solved by fixed-point iteration from the Euler
// predictor: energy is conserved to the error of the iteration, whatever the step.
#define DISCRETE_GRADIENT         \
    .nstage = 8, .order = 2,      \
    .a = {{0},                    \
          {1},                    \
          {0, 1},                 \
          {0, 0, 1},              \
          {0, 0, 0, 1},           \
          {0, 0, 0, 0, 1},        \
          {0, 0, 0, 0, 0, 1},     \
          {0, 0, 0, 0, 0, 0, 1}}, \
    .b = {0, 0, 0, 0, 0, 0, 0, 1}, .family = PM_DISCRETE_GRADIENT, .most_iterations = 50

// Every method: its name, then its members.
#define INTEGRATORS(METHOD)                       \
    METHOD("euler", EULER)                        \
    METHOD("heun", HEUN)                          \
    METHOD("rk4", RK4)                            \
    METHOD("rk4_balanced", RK4, .balanced = true) \
    METHOD("rk6", RK6)                            \
    METHOD("rk6_balanced", RK6, .balanced = true) \
    METHOD("discrete_gradient", DISCRETE_GRADIENT)

#define ENTRY(name_, ...) {.name = name_, __VA_ARGS__},
#define LISTED(name_, ...) ", " name_

static const pm_integrator integrators[] = {INTEGRATORS(ENTRY)};

const pm_integrator *pm_integrator_find(const char *name) {
    for (size_t i = 0; i < sizeof integrators / sizeof *integrators; ++i) {
        if (strcmp(integrators[i].name, name) == 0) {
            return &integrators[i];
        }
    }
    return NULL;
}

double pm_integrator_time(const pm_integrator *rk, int stage) {
    if (pm_integrator_iterates(rk)) {
        return 0.5;
    }
    double sum = 0;
    for (int i = 0; i < stage; ++i) {
        sum += rk->a[stage][i];
    }
    return sum;
}

const char *pm_integrator_names(void) {
    return &(INTEGRATORS(LISTED))[2]; // without the first comma
}
