// Checks of sums that must be zero or not negative, such as dE . zdot. The rounding error of such a
// sum is proportional to the sum of the magnitudes of its terms.
#ifndef PM_TESTS_BALANCE_H
#define PM_TESTS_BALANCE_H

#include <math.h>

#include "tests/support/random_system.h"

typedef struct balance {
    double net, gross;
} balance;

static inline balance balance_of(int n, const double *x, const double *y) {
    balance b = {0, 0};
    for (int i = 0; i < n; ++i) {
        b.net += x[i] * y[i];
        b.gross += fabs(x[i] * y[i]);
    }
    return b;
}

static inline balance balance_add(balance a, balance b) {
    return (balance){a.net + b.net, a.gross + b.gross};
}

static inline double largest(int n, const double *x) {
    double result = 0;
    for (int i = 0; i < n; ++i) {
        result = fmax(result, fabs(x[i]));
    }
    return result;
}

static inline void check_zero(const random_system *w, const char *what, balance b,
                              double tolerance) {
    random_system_check(w, what, b.net, 0, tolerance * b.gross);
}

static inline void check_not_negative(const random_system *w, const char *what, balance b,
                                      double tolerance) {
    if (!(b.net >= -tolerance * b.gross)) {
        random_system_fail(w, "%s: %.17g, expected >= 0 within %g of %g", what, b.net, tolerance,
                           b.gross);
    }
}

#endif
