// These loops apply the functions of elementary.h, and the square root, to every entry of an array.
// The compiler vectorises them, which does not change a bit of the results.
#ifndef PM_BASE_ACTIVATION_H
#define PM_BASE_ACTIVATION_H

#include <stddef.h>

// Each computes y[i] = f(x[i]) for i < n; y may be x. They cannot fail.
void pm_array_tanh(size_t n, const double *x, double *y);
void pm_array_sigmoid(size_t n, const double *x, double *y);  // 1 / (1 + exp(-x))
void pm_array_softplus(size_t n, const double *x, double *y); // log(1 + exp(x))
void pm_array_exp(size_t n, const double *x, double *y);
void pm_array_log(size_t n, const double *x, double *y);
void pm_array_sqrt(size_t n, const double *x, double *y);

#endif
