// The table of integrators. An implicit method iterated a fixed number of times is explicit too:
// its iterations are stages.
#include "sim/integrator.h"

#include <stddef.h>
#include <string.h>

static const pm_integrator integrators[] = {
    {.name = "euler", .nstage = 1, .order = 1, .a = {{0}}, .b = {1}},
    {.name = "heun", .nstage = 2, .order = 2, .a = {{0}, {1}}, .b = {0.5, 0.5}},
    // Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, table II.1.2.
    {.name = "rk4",
     .nstage = 4,
     .order = 4,
     .a = {{0}, {0.5}, {0, 0.5}, {0, 0, 1}},
     .b = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}},
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
        sum += rk->a[stage][i];
    }
    return sum;
}

const char *pm_integrator_names(void) {
    return "euler, heun, rk4, midpoint, discrete_gradient";
}
