// Records, snapshots and checkpoints: saved numbers load unchanged, and files of other inputs are
// refused.
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/serializer.h"
#include "store/snapshot.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

enum { COUNT = 5, DIGEST = 77, LAYOUT = 99, SESSION = 123456 };

static const pm_snapshot_key right = {
    .digest = DIGEST, .layout = LAYOUT, .count = COUNT, .owner = "upper of pair"};

static const double saved[COUNT] = {-1, 0.1, 1e300, -0.0, 5e-324};

static void assert_untouched(pm_status status, const char *part, const char *path,
                             pm_snapshot_key key) {
    double value[COUNT + 1] = {42, 42};
    int64_t session = 42;
    bool found;
    assert_int_equal(pm_snapshot_load(path, &key, &session, value, &found), status);
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
    assert_untouched(PM_OK, "", path, right);
    assert_int_equal(pm_snapshot_session(path, &right, &session, &found), PM_OK);
    assert_false(found);
    for (int i = 0; i < 2; ++i) {
        assert_int_equal(pm_snapshot_save(path, &right, SESSION + i, saved), PM_OK);
        assert_int_equal(pm_snapshot_load(path, &right, &session, value, &found), PM_OK);
        assert_true(found);
        assert_int_equal(session, SESSION + i);
        assert_memory_equal(value, saved, sizeof saved);
        session = 0;
        assert_int_equal(pm_snapshot_session(path, &right, &session, &found), PM_OK);
        assert_true(found && session == SESSION + i);
    }
    assert_int_equal(scratch_files(*state, 0), 1); // no temporary one
}

// The temporary name is a link to a file of somebody else, or what a killed process has left.
static void no_other_file_is_written(void **state) {
    const char *path = scratch_path(*state, "x.checkpoint");
    const char *temporary = scratch_path(*state, "x.checkpoint.tmp");
    const char *other = scratch_path(*state, "other");
    size_t size = 0;
    scratch_write(other, "mine", 4);
    assert_int_equal(symlink(other, temporary), 0);
    assert_int_equal(pm_snapshot_save(path, &right, SESSION, saved), PM_OK);
    char *content = scratch_read(other, &size);
    assert_int_equal(size, 4);
    assert_memory_equal(content, "mine", 4);
    free(content);
    scratch_write(temporary, "left", 4);
    assert_int_equal(pm_snapshot_save(path, &right, SESSION, saved), PM_OK);
    assert_int_equal(scratch_files(*state, 0), 2);
}

// Opening a pipe would wait for somebody who writes to it.
static void a_pipe_is_no_snapshot(void **state) {
    const char *path = scratch_path(*state, "pipe.checkpoint");
    int64_t session = 42;
    bool found;
    assert_int_equal(mkfifo(path, 0600), 0);
    alarm(10);
    assert_untouched(PM_EFILE, "not a file", path, right);
    assert_int_equal(pm_snapshot_session(path, &right, &session, &found), PM_EFILE);
    alarm(0);
}

static void others_are_refused(void **state) {
    const char *path = scratch_path(*state, "x.checkpoint");
    assert_int_equal(pm_snapshot_save(path, &right, SESSION, saved), PM_OK);
    const pm_snapshot_key others[] = {{DIGEST + 1, LAYOUT, COUNT, right.owner},
                                      {DIGEST, LAYOUT + 1, COUNT, right.owner},
                                      {DIGEST, LAYOUT, COUNT + 1, right.owner},
                                      {DIGEST, LAYOUT, COUNT - 1, right.owner}};
    const pm_snapshot_key lower = {DIGEST, LAYOUT, COUNT, "lower of pair"};
    assert_untouched(PM_EFILE, "belongs to \"upper of pair\", expected one of \"lower of pair\"",
                     path, lower);
    for (size_t i = 0; i < sizeof others / sizeof others[0]; ++i) {
        assert_untouched(PM_EFILE, "remove it to begin anew", path, others[i]);
    }
    assert_int_equal(pm_snapshot_save("/nowhere/x", &right, SESSION, saved), PM_EFILE);
}

// Every byte changed, and every length.
static void damage_is_found(void **state) {
    const char *path = scratch_path(*state, "x.checkpoint");
    size_t size;
    assert_int_equal(pm_snapshot_save(path, &right, SESSION, saved), PM_OK);
    char *data = scratch_read(path, &size);
    for (size_t i = 0; i < size; ++i) {
        if (i >= 20 && i < 24) {
            continue; // padding
        }
        data[i] ^= 0x10;
        scratch_write(path, data, size);
        assert_untouched(PM_EFILE, "snapshot", path, right);
        data[i] ^= 0x10;
        scratch_write(path, data, i);
        assert_untouched(PM_EFILE, "snapshot", path, right);
    }
    free(data);
}

// One list counts, saves and restores; names and counts make the layout.
static void records_give_back_what_they_took(void **state) {
    (void)state;
    double z[2] = {1.5, -2}, number[4];
    long step = 1L << 40;
    int count = -3;
    for (int pass = 0; pass < 3; ++pass) {
        pm_serializer serializer = pass == 0   ? pm_serializer_count("test")
                                   : pass == 1 ? pm_serializer_save("test", number)
                                               : pm_serializer_restore("test", number);
        pm_serializer_put(&serializer, "z", z, 2);
        pm_serializer_put_long(&serializer, "step", &step);
        pm_serializer_put_int(&serializer, "count", &count);
        assert_int_equal(serializer.count, 4);
        if (pass == 1) {
            z[0] = z[1] = 0;
            step = count = 0;
        }
    }
    assert_true(z[0] == 1.5 && z[1] == -2 && step == 1L << 40 && count == -3);
}

static uint64_t layout_of(const char *kind, const char *name, int count) {
    double value[2] = {0};
    pm_serializer serializer = pm_serializer_count(kind);
    pm_serializer_put(&serializer, name, value, count);
    return serializer.layout;
}

static void layouts_differ_by_kind_name_and_count(void **state) {
    (void)state;
    const uint64_t layout = layout_of("node", "z", 2);
    assert_true(layout == layout_of("node", "z", 2));
    assert_true(layout != layout_of("coordinator", "z", 2));
    assert_true(layout != layout_of("node", "y", 2));
    assert_true(layout != layout_of("node", "z", 1));
}

static void checkpoints_open_for_the_same_work_only(void **state) {
    const char *path = scratch_path(*state, "fit.checkpoint");
    double theta[2] = {1, 2}, position[1] = {3};
    const pm_checkpoint_field field[] = {{"theta", 2, theta}, {"position", 1, position}};
    const pm_checkpoint_field renamed[] = {{"theta", 2, theta}, {"place", 1, position}};
    assert_int_equal(pm_checkpoint_load(path, "fit", 7, 2, field), PM_EFILE); // missing
    assert_int_equal(pm_checkpoint_save(path, "fit", 7, 2, field), PM_OK);
    theta[0] = theta[1] = position[0] = 0;
    assert_int_equal(pm_checkpoint_load(path, "fit", 8, 2, field), PM_EFILE);
    assert_int_equal(pm_checkpoint_load(path, "search", 7, 2, field), PM_EFILE);
    assert_int_equal(pm_checkpoint_load(path, "fit", 7, 1, field), PM_EFILE);
    assert_int_equal(pm_checkpoint_load(path, "fit", 7, 2, renamed), PM_EFILE);
    assert_true(theta[0] == 0 && position[0] == 0);
    assert_int_equal(pm_checkpoint_load(path, "fit", 7, 2, field), PM_OK);
    assert_true(theta[0] == 1 && theta[1] == 2 && position[0] == 3);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_was_saved_comes_back, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(no_other_file_is_written, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(a_pipe_is_no_snapshot, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(others_are_refused, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(damage_is_found, scratch_setup, scratch_teardown),
        cmocka_unit_test(records_give_back_what_they_took),
        cmocka_unit_test(layouts_differ_by_kind_name_and_count),
        cmocka_unit_test_setup_teardown(checkpoints_open_for_the_same_work_only, scratch_setup,
                                        scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
