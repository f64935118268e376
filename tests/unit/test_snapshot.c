// Snapshots: what was saved comes back, and nothing else does.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
// cmocka needs the above.
#include <cmocka.h>

#include "store/snapshot.h"
#include "tests/support/scratch.h"

enum { COUNT = 5, DIGEST = 77, SESSION = 123456 };

static const double saved[COUNT] = {-1, 0.1, 1e300, -0.0, 5e-324};

static void assert_untouched(pm_status status, const char *part, const char *path, uint64_t digest,
                             int count) {
    double value[COUNT + 1] = {42, 42};
    int64_t session = 42;
    bool found;
    assert_int_equal(pm_snapshot_load(path, digest, &session, count, value, &found), status);
    if (status != PM_OK && strstr(pm_error(), part) == NULL) {
        fail_msg("error \"%s\" does not contain \"%s\"", pm_error(), part);
    }
    assert_true(value[0] == 42 && value[1] == 42);
    assert_int_equal(session, 42);
}

static void what_was_saved_comes_back(void **state) {
    const char *path = scratch_path(*state, "x.checkpoint");
    double value[COUNT];
    int64_t session = 0;
    bool found = true;
    assert_untouched(PM_OK, "", path, DIGEST, COUNT);
    assert_int_equal(pm_snapshot_session(path, DIGEST, &session, &found), PM_OK);
    assert_false(found);
    for (int i = 0; i < 2; ++i) {
        assert_int_equal(pm_snapshot_save(path, DIGEST, SESSION + i, COUNT, saved), PM_OK);
        assert_int_equal(pm_snapshot_load(path, DIGEST, &session, COUNT, value, &found), PM_OK);
        assert_true(found);
        assert_int_equal(session, SESSION + i);
        assert_memory_equal(value, saved, sizeof saved);
        session = 0;
        assert_int_equal(pm_snapshot_session(path, DIGEST, &session, &found), PM_OK);
        assert_true(found && session == SESSION + i);
    }
    assert_int_equal(scratch_files(*state, 0), 1); // no temporary one
}

static void others_are_refused(void **state) {
    const char *path = scratch_path(*state, "x.checkpoint");
    assert_int_equal(pm_snapshot_save(path, DIGEST, SESSION, COUNT, saved), PM_OK);
    assert_untouched(PM_EFILE, "remove it to begin anew", path, DIGEST + 1, COUNT);
    assert_untouched(PM_EFILE, "damaged", path, DIGEST, COUNT + 1);
    assert_untouched(PM_EFILE, "damaged", path, DIGEST, COUNT - 1);
    assert_int_equal(pm_snapshot_save("/nowhere/x", DIGEST, SESSION, COUNT, saved), PM_EFILE);
}

// Every byte changed, and every length.
static void damage_is_found(void **state) {
    const char *path = scratch_path(*state, "x.checkpoint");
    size_t size;
    assert_int_equal(pm_snapshot_save(path, DIGEST, SESSION, COUNT, saved), PM_OK);
    char *data = scratch_read(path, &size);
    for (size_t i = 0; i < size; ++i) {
        if (i >= 20 && i < 24) {
            continue; // padding
        }
        data[i] ^= 0x10;
        scratch_write(path, data, size);
        assert_untouched(PM_EFILE, "snapshot", path, DIGEST, COUNT);
        data[i] ^= 0x10;
        scratch_write(path, data, i);
        assert_untouched(PM_EFILE, "snapshot", path, DIGEST, COUNT);
    }
    free(data);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_was_saved_comes_back, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(others_are_refused, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(damage_is_found, scratch_setup, scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
