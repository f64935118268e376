// Compares times with multiples of dt.
#include "store/times.h"

#include <math.h>

// How far a stored time may lie from t0 + j dt, in units of dt. Files of other tools may round
// times to a few digits.
#define TOLERANCE 1e-3

pm_status pm_times_check(const char *path, int ntime, const double *t, double dt) {
    if (!isfinite(dt) || dt <= 0) {
        return pm_fail(PM_EDATA, "%s: dt is %g, expected a number > 0", path, dt);
    }
    for (int j = 0; j < ntime; ++j) {
        const double expected = t[0] + j * dt;
        if (!(fabs(t[j] - expected) <= TOLERANCE * dt)) {
            return pm_fail(PM_EDATA, "%s: t[%d] is %.9g, expected t[0] + %d dt = %.9g", path, j,
                           t[j], j, expected);
        }
    }
    return PM_OK;
}
