// A program does not overwrite a file that it reads, and a later file that has its inode is
// another.
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/files.h"
#include "tests/support/unit.h"

enum { TRIES = 64 };

static ino_t write_file(const char *path) {
    struct stat facts;
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(stat(path, &facts), 0);
    return facts.st_ino;
}

static void an_input_is_not_overwritten(void **state) {
    (void)state;
    char path[] = "/tmp/test_files_XXXXXX";
    assert_int_equal(close(mkstemp(path)), 0);
    pm_files_note_input(path);
    assert_int_equal(pm_files_check_output(path, NULL), PM_EUSAGE);
    (void)unlink(path);
}

static void a_later_file_may_have_the_inode_of_an_input(void **state) {
    (void)state;
    char folder[] = "/tmp/test_files_XXXXXX", path[64];
    bool again = false;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/file", folder);
    for (int i = 0; i < TRIES && !again; ++i) {
        const ino_t inode = write_file(path);
        pm_files_note_input(path);
        (void)unlink(path);
        again = write_file(path) == inode;
        assert_int_equal(pm_files_check_output(path, NULL), PM_OK);
        (void)unlink(path);
    }
    (void)rmdir(folder);
    if (!again) {
        skip(); // this file system does not use an inode again at once
    }
}

static void a_link_is_no_output(void **state) {
    (void)state;
    char folder[] = "/tmp/test_files_XXXXXX", path[64], end[64];
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/link", folder);
    snprintf(end, sizeof end, "%s/end", folder);
    assert_int_equal(symlink(end, path), 0);
    assert_int_equal(pm_files_check_output(path, PM_FILES_ANY), PM_EFILE); // it leads to nothing
    (void)write_file(end);
    assert_int_equal(pm_files_check_output(path, PM_FILES_ANY), PM_EFILE);
    assert_int_equal(pm_files_check_output(end, PM_FILES_ANY), PM_OK);
    pm_files_note_input(end);
    assert_int_equal(pm_files_check_output(path, PM_FILES_ANY), PM_EUSAGE); // it is the input
    (void)unlink(path);
    (void)unlink(end);
    (void)rmdir(folder);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_input_is_not_overwritten),
        cmocka_unit_test(a_later_file_may_have_the_inode_of_an_input),
        cmocka_unit_test(a_link_is_no_output),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
