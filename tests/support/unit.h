// This header has what every unit and property test needs: cmocka with the headers that it wants
// before it, and checks that say what they have found. Failures end the test.
#ifndef PM_TESTS_SUPPORT_UNIT_H
#define PM_TESTS_SUPPORT_UNIT_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/status.h"

// Checks that a value differs from the expected one by the tolerance at most.
static inline void assert_near(const char *what, double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance)) {
        fail_msg("%s: %.17g, expected %.17g within %g", what, value, expected, tolerance);
    }
}

// Checks that a call has succeeded.
static inline void require(pm_status status) {
    if (status != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

#endif
