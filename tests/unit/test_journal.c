// Lines on standard error, as text and as JSON.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/journal.h"
#include "tests/support/unit.h"

#define SIZE 8192

static const pm_journal text_journal = {false, "portmetd", "run"};
static const pm_journal json_journal = {true, "portmetd", "run"};

// Standard error goes to a file between these two calls; the second one returns what was written
// there, in `text` [SIZE].
static int redirect(FILE *file) {
    fflush(stderr);
    const int kept = dup(STDERR_FILENO);
    assert_true(dup2(fileno(file), STDERR_FILENO) >= 0);
    return kept;
}

static void give_back(FILE *file, int kept, char *text) {
    fflush(stderr);
    assert_true(dup2(kept, STDERR_FILENO) >= 0);
    close(kept);
    rewind(file);
    text[fread(text, 1, SIZE - 1, file)] = 0;
    fclose(file);
}

#define WRITTEN(text, call)                \
    do {                                   \
        FILE *file_ = tmpfile();           \
        assert_non_null(file_);            \
        const int kept_ = redirect(file_); \
        call;                              \
        give_back(file_, kept_, text);     \
    } while (0)

// What follows the time of a JSON line.
static const char *after_time(const char *text) {
    static const char form[] = "{\"time\":\"dddd-dd-ddTdd:dd:dd.ddddddZ\",";
    for (size_t i = 0; i + 1 < sizeof form; ++i) {
        if (form[i] == 'd') {
            assert_in_range(text[i], '0', '9');
        } else {
            assert_int_equal(text[i], form[i]);
        }
    }
    return text + sizeof form - 1;
}

static void test_text(void **state) {
    (void)state;
    char text[SIZE];
    const pm_journal_field step = {.name = "step", .number = 3};
    WRITTEN(text, pm_journal_write(&text_journal, PM_JOURNAL_NOTICE, 1, &step, "held after %d", 3));
    assert_string_equal(text, "portmetd: held after 3\n");
    WRITTEN(text, pm_journal_write(&text_journal, PM_JOURNAL_WARNING, 0, NULL, "slow"));
    assert_string_equal(text, "portmetd: warning: slow\n");
    WRITTEN(text, pm_journal_pass_on(&text_journal, "upper", "portmetd: warning: slow"));
    assert_string_equal(text, "[upper] portmetd: warning: slow\n");
    WRITTEN(text, pm_journal_pass_on(&text_journal, "upper", ""));
    assert_string_equal(text, "");
}

static void test_json(void **state) {
    (void)state;
    char text[SIZE];
    const pm_journal_field field[] = {{.name = "step", .number = 3},
                                      {.name = "rate", .number = 0.1},
                                      {.name = "drift", .number = NAN},
                                      {.name = "silent", .text = "a, b"}};
    WRITTEN(text, pm_journal_write(&json_journal, PM_JOURNAL_NOTICE, 4, field, "held after %d", 3));
    assert_string_equal(after_time(text),
                        "\"level\":\"notice\",\"part\":\"run\",\"message\":\"held after 3\","
                        "\"fields\":{\"step\":3,\"rate\":0.10000000000000001,\"drift\":null,"
                        "\"silent\":\"a, b\"}}\n");
    WRITTEN(text, pm_journal_pass_on(&json_journal, "upper", "portmetd: warning: slow"));
    assert_string_equal(after_time(text), "\"level\":\"warning\",\"part\":\"upper\",\"message\":"
                                          "\"slow\",\"fields\":{}}\n");
    WRITTEN(text, pm_journal_pass_on(&json_journal, "upper", "library: odd"));
    assert_string_equal(after_time(text), "\"level\":\"notice\",\"part\":\"upper\",\"message\":"
                                          "\"library: odd\",\"fields\":{}}\n");
}

// Quotes, backslashes and control characters of names stay inside their strings.
static void test_hostile_text(void **state) {
    (void)state;
    char text[SIZE];
    WRITTEN(text,
            pm_journal_write(&json_journal, PM_JOURNAL_ERROR, 0, NULL, "%s", "a\"b\\c\nd\x1b"));
    assert_string_equal(after_time(text), "\"level\":\"error\",\"part\":\"run\",\"message\":"
                                          "\"a\\\"b\\\\c\\u000ad\\u001b\",\"fields\":{}}\n");
}

// A message that is too long is cut, and the line is still whole.
static void test_long_text(void **state) {
    (void)state;
    char text[SIZE], *message = malloc(100000);
    assert_non_null(message);
    memset(message, '\n', 99999); // six bytes each
    message[99999] = 0;
    const pm_journal_field field[] = {{.name = "name", .text = message},
                                      {.name = "step", .number = 3}};
    WRITTEN(text, pm_journal_write(&json_journal, PM_JOURNAL_ERROR, 2, field, "%s", message));
    const size_t length = strlen(text);
    assert_in_range(length, 2000, 4096);
    assert_string_equal(text + length - 13, "\",\"step\":3}}\n");
    free(message);
}

static void test_forms(void **state) {
    (void)state;
    bool json = true;
    assert_int_equal(pm_journal_read_form(NULL, &json), PM_OK);
    assert_false(json);
    assert_int_equal(pm_journal_read_form("json", &json), PM_OK);
    assert_true(json);
    assert_int_equal(pm_journal_read_form("text", &json), PM_OK);
    assert_false(json);
    assert_int_equal(pm_journal_read_form("xml", &json), PM_EUSAGE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_text),         cmocka_unit_test(test_json),
        cmocka_unit_test(test_hostile_text), cmocka_unit_test(test_long_text),
        cmocka_unit_test(test_forms),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
