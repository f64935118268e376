// Names of columns: lookups among many names, and the expansion and folding of ranges.
#include <string.h>

#include "store/names.h"
#include "tests/support/unit.h"

static pm_arena arena;

static int teardown(void **state) {
    (void)state;
    pm_arena_free(&arena);
    return 0;
}

static void names_are_found(void **state) {
    (void)state;
    static const char *const text[] = {"q1", "p", "q10", "q", "p0"};
    pm_names names;
    assert_int_equal(pm_names_sort(&names, text, 5, &arena), PM_OK);
    for (int i = 0; i < 5; ++i) {
        assert_int_equal(pm_names_find(&names, text[i]), i);
    }
    assert_int_equal(pm_names_find(&names, "q2"), -1);
    assert_int_equal(pm_names_find(&names, ""), -1);
    assert_int_equal(pm_names_twice(&names), -1);
}

static void the_later_of_two_equal_names_is_told(void **state) {
    (void)state;
    static const char *const text[] = {"b", "a", "c", "b"};
    pm_names names;
    assert_int_equal(pm_names_sort(&names, text, 4, &arena), PM_OK);
    assert_int_equal(pm_names_twice(&names), 3);
}

static void texts_that_are_no_ranges_stand_for_themselves(void **state) {
    (void)state;
    static const char *const text[] = {"q", "q[0]", "a:b", "[0:3]x", "x]", "q0"};
    for (size_t i = 0; i < sizeof text / sizeof text[0]; ++i) {
        pm_name_range range;
        assert_int_equal(pm_name_range_parse(&range, text[i]), PM_OK);
        assert_int_equal(range.count, 1);
        assert_string_equal(pm_name_range_text(&range, 0, &arena), text[i]);
    }
}

static void bad_ranges_are_refused(void **state) {
    (void)state;
    static const char *const text[] = {
        "f[3:3]",   "f[3:1]",
        "f[-1:3]",  "f[0:+3]",
        "f[:3]",    "f[0:]",
        "f[0:3:6]", "f[ 0:3]",
        "[0:3]",    "f[0:1000000001]",
        "f[0x1:3]", "f[0:99999999999999999999999]",
        "f[0 :3]",  "f[a:b]",
        "f[0:3:]",  "0123456789012345678901234567890123456789012345678901234567890123x[0:3]"};
    for (size_t i = 0; i < sizeof text / sizeof text[0]; ++i) {
        pm_name_range range;
        if (pm_name_range_parse(&range, text[i]) != PM_ECONFIG ||
            strstr(pm_error(), "PREFIX[A:B]") == NULL) {
            fail_msg("%s is taken for a range", text[i]);
        }
    }
}

static void folding_keeps_what_ranges_stand_for(void **state) {
    (void)state;
    static const char *const text[] = {"t",   "a0",  "a1",  "a2",   "a3",   "b7",   "b8",
                                       "c9",  "c10", "c11", "c0_0", "c0_1", "c0_2", "d00",
                                       "d01", "d02", "1",   "2",    "3",    "e"};
    const int count = sizeof text / sizeof text[0];
    const char *folded = pm_names_fold(text, count, &arena);
    assert_string_equal(folded, "t a[0:4] b7 b8 c[9:12] c0_[0:3] d00 d01 d02 1 2 3 e");
    char copy[128];
    strcpy(copy, folded);
    int n = 0;
    for (char *word = strtok(copy, " "); word != NULL; word = strtok(NULL, " ")) {
        pm_name_range range;
        assert_int_equal(pm_name_range_parse(&range, word), PM_OK);
        for (int i = 0; i < range.count; ++i) {
            assert_string_equal(pm_name_range_text(&range, i, &arena), text[n++]);
        }
    }
    assert_int_equal(n, count);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(names_are_found, teardown),
        cmocka_unit_test_teardown(the_later_of_two_equal_names_is_told, teardown),
        cmocka_unit_test_teardown(texts_that_are_no_ranges_stand_for_themselves, teardown),
        cmocka_unit_test_teardown(bad_ranges_are_refused, teardown),
        cmocka_unit_test_teardown(folding_keeps_what_ranges_stand_for, teardown),
    };
    return cmocka_run_group_tests_name("names", tests, NULL, NULL);
}
