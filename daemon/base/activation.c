// The only file that is compiled with relaxed floating-point rules (CMakeLists.txt), so that the
// compiler turns its loops into calls of the vector mathematics library.
#include "base/activation.h"

#include <math.h>

#include "base/simd.h"

PM_SIMD_CLONES void pm_array_tanh(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = tanh(x[i]);
    }
}

PM_SIMD_CLONES void pm_array_sigmoid(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = 1.0 / (1.0 + exp(-x[i]));
    }
}

PM_SIMD_CLONES void pm_array_softplus(size_t n, const double *x, double *y) {
    // This form, max(x, 0) + log(1 + exp(-|x|)), does not overflow.
    for (size_t i = 0; i < n; ++i) {
        const double magnitude = x[i] < 0 ? -x[i] : x[i];
        y[i] = (x[i] > 0 ? x[i] : 0) + log1p(exp(-magnitude));
    }
}

PM_SIMD_CLONES void pm_array_exp(size_t n, const double *x, double *y) {
    for (size_t i = 0; i < n; ++i) {
        y[i] = exp(x[i]);
    }
}
