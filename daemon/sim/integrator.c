// The table of integrators. An implicit method iterated a fixed number of times is explicit too:
// its iterations are stages.
#include "sim/integrator.h"

#include <stddef.h>
#include <string.h>

// Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, table II.1.2; beside it the
// midpoint rule of its second stage.
#define RK4                                                          \
    .nstage = 4, .order = 4, .a = {{0}, {0.5}, {0, 0.5}, {0, 0, 1}}, \
    .b = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}, .embedded = 2,        \
    .error_weights = {1.0 / 6, -2.0 / 3, 1.0 / 3, 1.0 / 6}

#define SQRT5 2.23606797749978969641

// Butcher, Numerical Methods for Ordinary Differential Equations (2016), section 326: on the
// abscissae of Lobatto's quadrature, and so without negative weights.
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

// MRI-GARK-ERK33a (Sandu, SIAM J. Numer. Anal. 57 (2019) 2300), from Heun's third-order method.
#define MULTIRATE3                                                                                \
    .nstage = 3, .order = 3, .multirate = true, .width = {1.0 / 3, 1.0 / 3, 1.0 / 3},             \
    .a = {{1.0 / 3}, {-1.0 / 3, 2.0 / 3}, {0, -2.0 / 3, 1}}, .slope = {{0}, {0}, {0.5, 0, -0.5}}, \
    .b = {0.25, 0, 0.75}

static const pm_integrator integrators[] = {
    {.name = "euler", .nstage = 1, .order = 1, .a = {{0}}, .b = {1}},
    {.name = "heun",
     .nstage = 2,
     .order = 2,
     .a = {{0}, {1}},
     .b = {0.5, 0.5},
     .embedded = 1,
     .error_weights = {-0.5, 0.5}},
    {.name = "rk4", RK4},
    {.name = "rk4_balanced", RK4, .balanced = true},
    {.name = "rk6", RK6},
    {.name = "rk6_balanced", RK6, .balanced = true},
    {.name = "multirate3", MULTIRATE3},
    {.name = "multirate3_balanced", MULTIRATE3, .balanced = true},
    // Implicit midpoint, k = f(z + h/2 k), by fixed-point iteration from the Euler predictor. Its
    // error is that of the midpoint rule once the iteration has contracted below it.
    {.name = "midpoint",
     .nstage = 5,
     .order = 2,
     .a = {{0}, {0.5}, {0, 0.5}, {0, 0, 0.5}, {0, 0, 0, 0.5}},
     .b = {0, 0, 0, 0, 1}},
    // Discrete gradients (Gonzalez 1996; for thermoelastic systems Romero, Int. J. Numer. Meth.
    // Engng 79 (2009) 706) by fixed-point iteration from the Euler predictor: energy is conserved
    // as well as the iteration has converged, whatever the step.
    {.name = "discrete_gradient",
     .nstage = 8,
     .order = 2,
     .a = {{0},
           {1},
           {0, 1},
           {0, 0, 1},
           {0, 0, 0, 1},
           {0, 0, 0, 0, 1},
           {0, 0, 0, 0, 0, 1},
           {0, 0, 0, 0, 0, 0, 1}},
     .b = {0, 0, 0, 0, 0, 0, 0, 1},
     .discrete = true},
};

const pm_integrator *pm_integrator_find(const char *name) {
    for (size_t i = 0; i < sizeof integrators / sizeof *integrators; ++i) {
        if (strcmp(integrators[i].name, name) == 0) {
            return &integrators[i];
        }
    }
    return NULL;
}

double pm_integrator_time(const pm_integrator *rk, int stage) {
    if (rk->discrete) {
        return 0.5;
    }
    double sum = 0;
    for (int i = 0; i < stage; ++i) {
        sum += rk->multirate ? rk->width[i] : rk->a[stage][i];
    }
    return sum;
}

const char *pm_integrator_names(void) {
    return "euler, heun, rk4, rk4_balanced, rk6, rk6_balanced, multirate3, multirate3_balanced, "
           "midpoint, discrete_gradient";
}
