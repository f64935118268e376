// Texts as JSON strings: escapes, bytes that are no UTF-8, and texts that are too long.
#include <string.h>

#include "base/journal.h"
#include "tests/support/unit.h"

static void assert_quoted(const char *text, const char *expected) {
    char quoted[256];
    assert_int_equal(pm_json_quote(quoted, sizeof quoted, text), strlen(expected));
    assert_string_equal(quoted, expected);
}

static void test_plain_and_escaped(void **state) {
    (void)state;
    assert_quoted("", "\"\"");
    assert_quoted("upper / lower", "\"upper / lower\"");
    assert_quoted("a\"b\\c", "\"a\\\"b\\\\c\"");
    assert_quoted("a\nb\tc\x1b\x7f", "\"a\\u000ab\\u0009c\\u001b\\u007f\"");
}

static void test_utf8(void **state) {
    (void)state;
    assert_quoted("\xc2\xb5s \xe2\x82\xac \xf0\x9f\x99\x82",
                  "\"\xc2\xb5s \xe2\x82\xac \xf0\x9f\x99\x82\"");
    static const char *const wrong[] = {
        "\xe4",             // Latin-1
        "\x80",             // a continuation without a beginning
        "\xc0\xaf",         // overlong
        "\xe0\x80\xaf",     // overlong
        "\xed\xa0\x80",     // a surrogate
        "\xf4\x90\x80\x80", // beyond U+10FFFF
        "\xf0\x9f\x99",     // cut off
        "\xff",
    };
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; ++i) {
        char expected[64] = "\"a";
        for (size_t k = 0; k < strlen(wrong[i]); ++k) {
            strcat(expected, "\\ufffd");
        }
        strcat(expected, "b\"");
        char text[16];
        strcat(strcat(strcpy(text, "a"), wrong[i]), "b");
        assert_quoted(text, expected);
    }
}

// A string that is cut to any size ends with a quotation mark after a whole character.
static void test_cut(void **state) {
    (void)state;
    static const char text[] = "a\nb\xe2\x82\xac"
                               "c";
    static const struct {
        size_t size;
        const char *expected;
    } cases[] = {
        {3, "\"\""},
        {4, "\"a\""},
        {9, "\"a\""},
        {10, "\"a\\u000a\""},
        {13, "\"a\\u000ab\""},
        {14, "\"a\\u000ab\xe2\x82\xac\""},
        {15, "\"a\\u000ab\xe2\x82\xac"
             "c\""},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        char quoted[17];
        memset(quoted, 'x', sizeof quoted);
        assert_int_equal(pm_json_quote(quoted, cases[i].size, text), strlen(cases[i].expected));
        assert_string_equal(quoted, cases[i].expected);
        assert_int_equal(quoted[cases[i].size], 'x');
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_plain_and_escaped),
        cmocka_unit_test(test_utf8),
        cmocka_unit_test(test_cut),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
