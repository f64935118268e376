// Elementwise transcendental functions over arrays, vectorised by the compiler (a few ulp).
// Arguments must be finite for the result to mean anything: callers check values once per step.
#ifndef PM_BASE_ACTIVATION_H
#define PM_BASE_ACTIVATION_H

#include <stddef.h>

// y[i] = f(x[i]), i < n; y may be x.
void pm_array_tanh(size_t n, const double *x, double *y);
void pm_array_sigmoid(size_t n, const double *x, double *y);
void pm_array_softplus(size_t n, const double *x, double *y);
void pm_array_exp(size_t n, const double *x, double *y);

#endif
