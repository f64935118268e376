// Loops over the functions of elementary.h and square roots, which the compiler vectorises.
#include "base/activation.h"

#include <math.h>

#include "base/elementary.h"
#include "base/simd.h"

PM_SIMD_CLONES void pm_array_tanh(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = pm_tanh_of(x[i]);
    }
}

PM_SIMD_CLONES void pm_array_sigmoid(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = pm_sigmoid_of(x[i]);
    }
}

PM_SIMD_CLONES void pm_array_softplus(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = pm_softplus_of(x[i]);
    }
}

PM_SIMD_CLONES void pm_array_exp(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = pm_exp_of(x[i]);
    }
}

PM_SIMD_CLONES void pm_array_log(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = pm_log_of(x[i]);
    }
}

PM_SIMD_CLONES void pm_array_sqrt(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = sqrt(x[i]);
    }
}
