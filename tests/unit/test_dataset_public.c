// Reads the public data of the method's authors as a dataset. The data are not part of this
// repository; without them the test is skipped.
#include <math.h>
#include <stdio.h>
#include <unistd.h>

#include "store/dataset.h"
#include "tests/support/unit.h"

#define PUBLIC_DATA "../shared/data/double_pendulum.h5"
#define SKIPPED 77 // the exit code that ctest reports as skipped

static void the_public_double_pendulum_is_read(void **state) {
    (void)state;
    pm_dataset *d = NULL;
    if (pm_dataset_load(&d, PUBLIC_DATA) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_int_equal(d->ntrajectory, 40);
    assert_int_equal(d->ntime, 200);
    assert_int_equal(d->ncolumn, 10);
    assert_true(fabs(d->dt - 0.3) < 1e-15);
    assert_string_equal(d->column[0], "q1x");
    assert_string_equal(d->column[9], "s2");
    assert_true(d->nnote >= 3);
    pm_dataset_free(d);
}

int main(void) {
    if (access(PUBLIC_DATA, R_OK) != 0) {
        printf("skipped: there is no " PUBLIC_DATA "\n");
        return SKIPPED;
    }
    const struct CMUnitTest tests[] = {cmocka_unit_test(the_public_double_pendulum_is_read)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
