// The YAML reader: values come back as written; every error is one line with file, line and column.
#include <float.h>
#include <limits.h>
#include <math.h>

#include "store/yaml.h"
#include "tests/support/scratch.h"
#include "tests/support/yaml_case.h"

static const char good[] = "name: \"a \\\"b\\\" c\"   # a comment\n"
                           "count: 12\n"
                           "numbers: [1, -2.5, 1.0e-3]\n"
                           "one: 7\n"
                           "flag: true\n"
                           "kind: heun\n"
                           "nested:\n"
                           "  inner: {x: 0.1, words: [q, p]}\n";

static pm_yaml open_text(pm_yaml_document **document, const char *text) {
    pm_yaml root = {0};
    if (pm_yaml_parse(document, text, "t.yaml", &root) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return root;
}

static void test_scalars(void **state) {
    (void)state;
    pm_yaml_document *document = NULL;
    pm_arena arena = {0};
    const pm_yaml root = open_text(&document, good);
    const char *text;
    double x;
    int n;
    bool flag;
    assert_true(pm_yaml_is_map(root));
    assert_int_equal(pm_yaml_count(root), 7);
    assert_int_equal(pm_yaml_text(pm_yaml_get(root, "name"), &arena, &text), PM_OK);
    assert_string_equal(text, "a \"b\" c");
    assert_int_equal(pm_yaml_int(pm_yaml_get(root, "count"), 12, 12, &n), PM_OK);
    assert_int_equal(n, 12);
    assert_int_equal(pm_yaml_double(pm_yaml_get(root, "count"), DBL_MIN, INFINITY, &x), PM_OK);
    assert_true(x == 12.0);
    assert_int_equal(pm_yaml_bool(pm_yaml_get(root, "flag"), &flag), PM_OK);
    assert_true(flag);
    const char *const kinds[] = {"euler", "heun", NULL};
    assert_int_equal(pm_yaml_choice(pm_yaml_get(root, "kind"), kinds, &n), PM_OK);
    assert_int_equal(n, 1);
    const pm_yaml inner = pm_yaml_get(pm_yaml_get(root, "nested"), "inner");
    assert_int_equal(pm_yaml_double(pm_yaml_get(inner, "x"), 0.1, 0.1, &x), PM_OK);
    assert_true(x == 0.1);
    assert_false(pm_yaml_exists(pm_yaml_get(root, "absent")));
    assert_false(pm_yaml_exists(pm_yaml_get(pm_yaml_get(root, "one"), "x")));
    assert_string_equal(pm_yaml_where(pm_yaml_get(inner, "words"), &arena), "t.yaml:8:26");
    pm_arena_free(&arena);
    pm_yaml_close(document);
}

static void test_lists(void **state) {
    (void)state;
    pm_yaml_document *document = NULL;
    pm_arena arena = {0};
    const pm_yaml root = open_text(&document, good);
    const pm_yaml inner = pm_yaml_get(pm_yaml_get(root, "nested"), "inner");
    int count, *integer;
    double *number;
    const char **word;
    assert_int_equal(pm_yaml_doubles(pm_yaml_get(root, "numbers"), &arena, &count, &number), PM_OK);
    assert_int_equal(count, 3);
    assert_true(number[0] == 1 && number[1] == -2.5 && number[2] == 1e-3);
    assert_int_equal(pm_yaml_ints(pm_yaml_get(root, "one"), 0, 9, &arena, &count, &integer), PM_OK);
    assert_int_equal(count, 1);
    assert_int_equal(integer[0], 7);
    assert_int_equal(pm_yaml_texts(pm_yaml_get(inner, "words"), &arena, &count, &word), PM_OK);
    assert_int_equal(count, 2);
    assert_string_equal(word[1], "p");
    pm_yaml key, value;
    pm_yaml_entry(root, 1, &key, &value);
    assert_true(pm_yaml_is_text(key, "count") && pm_yaml_is_text(value, "12"));
    pm_arena_free(&arena);
    pm_yaml_close(document);
}

// Reads everything that `good` holds, in order.
static pm_status read_all(pm_yaml root) {
    static const char *const keys[] = {"name", "count", "numbers", "one",
                                       "flag", "kind",  "nested",  NULL};
    static const char *const kinds[] = {"euler", "heun", NULL};
    pm_arena arena = {0};
    pm_status status;
    pm_yaml value;
    const char *text;
    double *numbers, x;
    int n;
    bool flag;
    PM_TRY_DONE(pm_yaml_allow(root, keys));
    PM_TRY_DONE(pm_yaml_require(root, "name", &value));
    PM_TRY_DONE(pm_yaml_text(value, &arena, &text));
    PM_TRY_DONE(pm_yaml_int(pm_yaml_get(root, "count"), 1, 100, &n));
    PM_TRY_DONE(pm_yaml_doubles(pm_yaml_get(root, "numbers"), &arena, &n, &numbers));
    PM_TRY_DONE(pm_yaml_int(pm_yaml_get(root, "one"), INT_MIN, INT_MAX, &n));
    PM_TRY_DONE(pm_yaml_bool(pm_yaml_get(root, "flag"), &flag));
    PM_TRY_DONE(pm_yaml_choice(pm_yaml_get(root, "kind"), kinds, &n));
    PM_TRY_DONE(pm_yaml_require(root, "nested", &value));
    PM_TRY_DONE(pm_yaml_require_entries(value));
    PM_TRY_DONE(pm_yaml_require(value, "inner", &value));
    PM_TRY_DONE(pm_yaml_double(pm_yaml_get(value, "x"), DBL_MIN, INFINITY, &x));
done:
    pm_arena_free(&arena);
    return status;
}

static const yaml_case bad[] = {
    // values
    {"count: 12", "count: 0", "0", "count: expected a whole number >= 1 and <= 100, found \"0\""},
    {"count: 12", "count: 1.5", "1.5", "whole number"},
    {"count: 12", "count: 99999999999999999999", "9999", "whole number"},
    {"count: 12", "count: \"12\"", "\"12\"", "found the text \"12\""},
    {"count: 12", "count: [12]", "[12]", "found a list"},
    {"count: 12", "count:", "\nnumbers", "found nothing"},
    {"one: 7", "one: -", "-", "sequence entries are not allowed"},
    {"one: 7", "one: +-7", "+-7", "one: expected a whole number, found \"+-7\""},
    {"x: 0.1", "x: 0", "0", "x: expected a number > 0, found \"0\""},
    {"x: 0.1", "x: nan", "nan", "x: expected a number > 0"},
    {"x: 0.1", "x: .inf", ".inf", "x: expected a number > 0"},
    {"x: 0.1", "x: 1e999", "1e999", "x: expected a number > 0"},
    {"x: 0.1", "x: 0x10", "0x10", "x: expected a number > 0"},
    {"x: 0.1", "x: 1.0.0", "1.0.0", "x: expected a number > 0"},
    {"x: 0.1", "x: {y: 1}", "{y", "found a mapping"},
    {"-2.5", "two", "two", "numbers: expected a number, found \"two\""},
    {"[1, -2.5, 1.0e-3]", "{a: 1}", "{a", "numbers: expected a list of numbers, found a mapping"},
    {"flag: true", "flag: yes", "yes", "flag: expected one of false, true, found \"yes\""},
    {"kind: heun", "kind: rk9", "rk9", "kind: expected one of euler, heun, found \"rk9\""},
    {"name: \"a \\\"b\\\" c\"", "name: \"\"", "\"\"", "name: expected text, found nothing"},
    {"name: \"a \\\"b\\\" c\"", "name: [a]", "[a]", "name: expected text, found a list"},
    // keys
    {"count: 12", "cuont: 12", "cuont",
     "unknown key \"cuont\"; allowed: name, count, numbers, one"},
    {"inner:", "outer:", "outer", "nested: missing key \"inner\""},
    {"inner: {x: 0.1, words: [q, p]}", "inner", "inner",
     "nested: expected a mapping with at least"},
    {"count: 12", "name: 12", "name", "duplicate key \"name\""},
    {"count: 12", "[a, b]: 12", "[a", "expected a plain key, found a list"},
    // what YAML allows and a configuration does not
    {"count: 12", "count: &n 12\nagain: *n", "&n", "aliases are not supported"},
    {"[1, -2.5, 1.0e-3]", "&l [1, *l]", "&l", "aliases are not supported"},
    {"count: 12", "count: *n", "*n", "undefined alias"},
    {"count: 12", "count: !celsius 12", "!celsius", "tags are not supported, found !celsius"},
    {"count: 12", "count: \"1\\0\"", "\"1", "control characters"},
    {"count: 12", "count: |\n  12\n  13", "|", "one line"},
    {"count: 12", "count: \"1\\N2\"", "\"1", "one line"},
    {"count: 12", "count: \"1\\L2\"", "\"1", "one line"},
    {"count: 12", "count: \"1\\P2\"", "\"1", "one line"},
    // not YAML
    {"count: 12", "count: [12", ": [1,", "not valid YAML: did not find expected ',' or ']'"},
    {"count: 12", "\tcount: 12", "\tcount", "not valid YAML"},
    {"count: 12", "count: a: 12", ": 12", "not valid YAML"},
    {"count: 12", "count: \x01", "\x01", "not valid YAML: control characters"},
    {"count: 12", "count: \xff", "\xff", "not valid YAML"},
    {"nested:", "---\nnested:", "nested", "second document"},
};

static void test_bad(void **state) {
    (void)state;
    int failures = 0;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        char *text = yaml_case_text(good, &bad[i]);
        pm_yaml_document *document = NULL;
        pm_yaml root;
        pm_status status = pm_yaml_parse(&document, text, "t.yaml", &root);
        if (status == PM_OK) {
            status = read_all(root);
        }
        pm_yaml_close(document);
        free(text);
        failures += !yaml_case_holds("t.yaml", good, &bad[i], status);
    }
    assert_int_equal(failures, 0);
}

static void test_empty(void **state) {
    (void)state;
    const char *const texts[] = {"", "# nothing\n", "---\n...\n"};
    for (size_t i = 0; i < 2; ++i) {
        pm_yaml_document *document = NULL;
        pm_yaml root;
        assert_int_equal(pm_yaml_parse(&document, texts[i], "t.yaml", &root), PM_ECONFIG);
        assert_string_equal(pm_error(), "t.yaml:1:1: empty, expected a mapping");
        assert_null(document);
    }
    pm_yaml_document *document = NULL;
    const pm_yaml root = open_text(&document, texts[2]);
    assert_int_equal(pm_yaml_require_entries(root), PM_ECONFIG);
    pm_yaml_close(document);
}

static void test_file(void **state) {
    (void)state;
    scratch folder;
    scratch_open(&folder);
    pm_yaml_document *document = NULL;
    pm_yaml root;
    const char *path = scratch_path(&folder, "a.yaml");
    assert_int_equal(pm_yaml_open(&document, path, &root), PM_EFILE);
    assert_non_null(strstr(pm_error(), path));
    assert_int_equal(pm_yaml_open(&document, folder.folder, &root), PM_EFILE);
    scratch_write(path, good, sizeof good - 1);
    assert_int_equal(pm_yaml_open(&document, path, &root), PM_OK);
    assert_int_equal(read_all(root), PM_OK);
    pm_yaml_close(document);
    document = NULL;
    scratch_write(path, good, sizeof good); // with a NUL at the end
    assert_int_equal(pm_yaml_open(&document, path, &root), PM_ECONFIG);
    assert_null(document);
    scratch_close(&folder);
}

// Files of the sizes around which memory grows, up to the largest: to the last byte, and no more.
static void test_file_sizes(void **state) {
    (void)state;
    static const size_t largest = (size_t)1 << 20;
    const size_t size[] = {4094, 4095, 4096, 8191, 8192, largest, largest + 1, 2 * largest};
    static const char end[] = "\nlast: 7";
    char *text = malloc(2 * largest);
    assert_non_null(text);
    memset(text, '#', 2 * largest);
    scratch folder;
    scratch_open(&folder);
    const char *path = scratch_path(&folder, "a.yaml");
    for (size_t i = 0; i < sizeof size / sizeof *size; ++i) {
        pm_yaml_document *document = NULL;
        pm_yaml root;
        int last;
        memcpy(text + size[i] - strlen(end), end, strlen(end));
        scratch_write(path, text, size[i]);
        memset(text + size[i] - strlen(end), '#', strlen(end));
        const pm_status status = pm_yaml_open(&document, path, &root);
        assert_int_equal(status, size[i] > largest ? PM_ECONFIG : PM_OK);
        if (status == PM_OK) {
            assert_int_equal(pm_yaml_int(pm_yaml_get(root, "last"), 0, 9, &last), PM_OK);
            assert_int_equal(last, 7);
        } else {
            assert_non_null(strstr(pm_error(), "larger than 1048576 bytes"));
        }
        pm_yaml_close(document);
    }
    scratch_close(&folder);
    free(text);
}

// Hostile text of `size` bytes made of `unit` repeated: it must end, whatever it says.
static void feed(const char *unit, size_t size) {
    char *text = malloc(size + 1);
    assert_non_null(text);
    for (size_t i = 0; i < size; ++i) {
        text[i] = unit[i % strlen(unit)];
    }
    text[size] = '\0';
    pm_yaml_document *document = NULL;
    pm_yaml root;
    if (pm_yaml_parse(&document, text, "t.yaml", &root) != PM_OK) {
        assert_null(document);
        assert_null(strchr(pm_error(), '\n'));
    }
    pm_yaml_close(document);
    free(text);
}

static void test_hostile(void **state) {
    (void)state;
    const char *const units[] = {"[",   "{",  "- ", "? ",  "a: [", "{a: ",  "&a ",
                                 "*a ", "\"", "!",  "|\n", "a\n",  "- a\n", "[a,"};
    for (size_t i = 0; i < sizeof units / sizeof *units; ++i) {
        feed(units[i], 1000000);
    }
    feed("[", 1000);
    assert_string_equal(pm_error(), "t.yaml:1:201: more than 200 brackets are open at once");
    feed("&r {a: *r}", 10); // a value that holds itself
    assert_non_null(strstr(pm_error(), "aliases are not supported"));
    feed("# a comment ", ((size_t)1 << 20) + 1);
    assert_non_null(strstr(pm_error(), "larger than"));
    char *keys = malloc(200000), *end = keys;
    assert_non_null(keys);
    for (int i = 0; i < 10001; ++i) {
        end += sprintf(end, "k%d: 0\n", i);
    }
    pm_yaml_document *document = NULL;
    pm_yaml root;
    assert_int_equal(pm_yaml_parse(&document, keys, "t.yaml", &root), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "10001 entries"));
    free(keys);
}

// Changes leave comments and all other values as they are.
static void test_changes(void **state) {
    static const char text[] =
        "# \u2013 a comment\na: {x: 1}   # \u00e9\nb:\n  y: 2\n  z: [3]\nc:\n  - 4\nd: 5\n";
    static const char expected[] =
        "# \u2013 a comment\na: {new: [0], x: 1}   # \u00e9\nb:\n  new: 1\n  y: "
        "2\n  z: [7, 3]\nc:\n  - 8\n  - 4\nd: {e: 6}\n";
    pm_yaml_document *document = NULL;
    pm_yaml root;
    char *made = NULL;
    size_t size = 0;
    (void)state;
    assert_int_equal(pm_yaml_parse(&document, text, "text", &root), PM_OK);
    const pm_yaml b = pm_yaml_get(root, "b");
    pm_yaml_change change[] = {{pm_yaml_get(root, "d"), true, "{e: 6}"},
                               {pm_yaml_get(root, "c"), false, "8"},
                               {pm_yaml_get(b, "z"), false, "7"},
                               {b, false, "new: 1"},
                               {pm_yaml_get(root, "a"), false, "new: [0]"}};
    FILE *file = open_memstream(&made, &size);
    assert_non_null(file);
    pm_yaml_write_changed(document, (int)(sizeof change / sizeof *change), change, file);
    assert_int_equal(fclose(file), 0);
    assert_string_equal(made, expected);
    free(made);
    pm_yaml_close(document);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scalars), cmocka_unit_test(test_lists),
        cmocka_unit_test(test_bad),     cmocka_unit_test(test_empty),
        cmocka_unit_test(test_file),    cmocka_unit_test(test_file_sizes),
        cmocka_unit_test(test_hostile), cmocka_unit_test(test_changes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
