// Command lines: what options and positional arguments mean, and how mistakes are described.
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "tests/support/unit.h"

typedef struct given {
    const char *output, *data, *positional[3];
    int64_t count;
    double number;
    bool quiet;
    pm_words several;
} given;

// Reads up to 7 words before a NULL as the command "save" with positional arguments "SCENE NAME".
static pm_status read_words(given *g, const char *const *word, int least, int most) {
    union {
        const char *word[9];
        char *argv[9]; // options are read only, though argv is not const
    } line = {.word = {"save"}};
    int argc = 1;
    free(g->several.word);
    *g = (given){0};
    for (; word[argc - 1] != NULL; ++argc) {
        line.word[argc] = word[argc - 1];
    }
    const pm_option table[] = {
        {"--output", "-o", "FILE", NULL, &g->output, true, .help = "write FILE", .is_output = true},
        {"--data", NULL, "FILE", NULL, &g->data, false, .help = "read FILE"},
        {"--quiet", "-q", NULL, &g->quiet, NULL, false, .help = "print errors only"},
        {"--steps", NULL, "N", .count = &g->count, .least = 1, .most = 12, .help = "take N steps"},
        {"--time", NULL, "T", .positive = &g->number, .help = "s"},
    };
    const pm_options options = {
        .usage = "test save SCENE NAME -o FILE",
        .summary = "Saves.",
        .positional_name = "SCENE NAME",
        .positional = g->positional,
        .least = least,
        .most = most,
        .count = sizeof table / sizeof table[0],
        .option = table,
        .several = "--data",
        .words = &g->several,
    };
    return pm_options_read(&options, argc, line.argv);
}

#define WORDS(...) ((const char *const[]){__VA_ARGS__, NULL})

static void options_stand_anywhere(void **state) {
    (void)state;
    const char *const *const lines[] = {
        WORDS("a", "b", "--output", "x", "-q"),
        WORDS("-q", "--output=x", "a", "b"),
        WORDS("a", "-o", "x", "b", "--quiet"),
        WORDS("-o", "x", "-q", "--", "a", "b"),
    };
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; ++i) {
        given g = {0};
        assert_int_equal(read_words(&g, lines[i], 0, 0), PM_OK);
        assert_string_equal(g.output, "x");
        assert_string_equal(g.positional[0], "a");
        assert_string_equal(g.positional[1], "b");
        assert_true(g.quiet && g.data == NULL);
    }
    given g = {0};
    assert_int_equal(read_words(&g, WORDS("-o", "x", "--", "-a", "--data"), 0, 0), PM_OK);
    assert_string_equal(g.positional[1], "--data");
    assert_int_equal(read_words(&g, WORDS("-o", "-x", "a", "b", "--data="), 0, 0), PM_OK);
    assert_true(strcmp(g.output, "-x") == 0 && strcmp(g.data, "") == 0);
    free(g.several.word);
}

static void an_option_has_several_values(void **state) {
    (void)state;
    given g = {0};
    assert_int_equal(read_words(&g, WORDS("a", "b", "--data", "x", "y", "z", "-o", "o"), 0, 0),
                     PM_OK);
    assert_string_equal(g.data, "x");
    assert_int_equal(g.several.count, 3);
    assert_string_equal(g.several.word[2], "z");
    assert_int_equal(read_words(&g, WORDS("a", "-o", "o", "--data=x", "b"), 0, 0), PM_OK);
    assert_int_equal(g.several.count, 1);
    // The last values are arguments that are missing, but never the first value.
    assert_int_equal(read_words(&g, WORDS("-o", "o", "--data", "x", "y", "a", "b"), 0, 0), PM_OK);
    assert_int_equal(g.several.count, 2);
    assert_string_equal(g.positional[0], "a");
    assert_string_equal(g.positional[1], "b");
    assert_int_equal(read_words(&g, WORDS("-o", "o", "--data", "x", "a"), 0, 0), PM_EUSAGE);
    assert_int_equal(read_words(&g, WORDS("-o", "o", "--data", "x", "y"), -1, 2), PM_OK);
    assert_int_equal(g.several.count, 2);
    assert_null(g.positional[0]);
    free(g.several.word);
}

static void mistakes_are_named(void **state) {
    (void)state;
    const struct {
        const char *const *word;
        int least, most;
        const char *error;
    } cases[] = {
        {WORDS("-o", "x", "a"), 0, 0,
         "save: expected SCENE NAME, found 1 argument (NAME is missing)"},
        {WORDS("-o", "x"), 1, 3, "found 0 arguments (SCENE is missing)"},
        {WORDS("-o", "x", "a", "b", "c"), 0, 0, "found 3 arguments (unexpected \"c\")"},
        {WORDS("a", "b"), 0, 0, "--output FILE is missing"},
        {WORDS("a", "b", "-o"), 0, 0, "-o needs a value (FILE)"},
        {WORDS("a", "b", "--quiet=yes"), 0, 0, "--quiet takes no value"},
        {WORDS("a", "b", "--out", "x"), 0, 0, "unknown option \"--out\""},
        {WORDS("a", "b", "-x"), 0, 0, "unknown option \"-x\""},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        given g = {0};
        assert_int_equal(read_words(&g, cases[i].word, cases[i].least, cases[i].most), PM_EUSAGE);
        if (strstr(pm_error(), cases[i].error) == NULL) {
            fail_msg("found \"%s\", expected \"%s\"", pm_error(), cases[i].error);
        }
    }
    given g = {0};
    assert_int_equal(read_words(&g, WORDS("-o", "x", "a", "b", "c"), 1, 3), PM_OK);
    assert_string_equal(g.positional[2], "c");
    assert_int_equal(read_words(&g, WORDS("-o", "x", "a"), 1, 3), PM_OK);
}

static void help_needs_nothing_else(void **state) {
    (void)state;
    given g = {0};
    assert_int_equal(read_words(&g, WORDS("--wrong", "--help"), 0, 0), PM_HELPED);
}

static void ranges_count_from_zero(void **state) {
    (void)state;
    static const struct {
        const char *text;
        int first, end; // end 0: refused
    } cases[] = {
        {NULL, 0, 8}, {":", 0, 8},   {"3", 3, 4},   {"2:5", 2, 5},  {"6:", 6, 8}, {":2", 0, 2},
        {"8", 0, 0},  {"5:2", 0, 0}, {"0:9", 0, 0}, {"-1:2", 0, 0}, {"", 0, 0},   {"1:2x", 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        int first = 0, end = 0;
        const pm_status status = pm_options_range(cases[i].text, 8, &first, &end);
        assert_int_equal(status, cases[i].end == 0 ? PM_EUSAGE : PM_OK);
        assert_true(first == cases[i].first && end == cases[i].end);
    }
    int which[8], count = 0;
    assert_int_equal(pm_options_list("6:,0,2:4", 8, which, &count), PM_OK);
    assert_int_equal(count, 5);
    assert_memory_equal(which, ((int[]){6, 7, 0, 2, 3}), 5 * sizeof *which);
    assert_int_equal(pm_options_list("1,0:3", 8, which, &count), PM_EUSAGE);
    assert_int_equal(pm_options_list("1,,2", 8, which, &count), PM_EUSAGE);
}

static void numbers_are_checked(void **state) {
    (void)state;
    given g = {0};
    assert_int_equal(
        read_words(&g, WORDS("a", "b", "-o", "x", "--steps", "12", "--time=1e-3"), 0, 0), PM_OK);
    assert_int_equal(g.count, 12);
    assert_true(g.number == 1e-3);
    static const char *const no_count[] = {"13", "0", "-1", "1.5", "", "x", "99999999999999999999"};
    for (size_t i = 0; i < sizeof no_count / sizeof no_count[0]; ++i) {
        assert_int_equal(read_words(&g, WORDS("a", "b", "-o", "x", "--steps", no_count[i]), 0, 0),
                         PM_EUSAGE);
    }
    static const char *const no_number[] = {"0", "-1", "inf", "nan", "", "1s", "1,2"};
    for (size_t i = 0; i < sizeof no_number / sizeof no_number[0]; ++i) {
        assert_int_equal(read_words(&g, WORDS("a", "b", "-o", "x", "--time", no_number[i]), 0, 0),
                         PM_EUSAGE);
    }
}

static void an_output_needs_a_folder(void **state) {
    (void)state;
    given g = {0};
    assert_int_equal(read_words(&g, WORDS("a", "b", "-o", "no/such/folder/x"), 0, 0), PM_EFILE);
    assert_non_null(strstr(pm_error(), "--output no/such/folder/x: there is no folder"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(options_stand_anywhere),   cmocka_unit_test(an_option_has_several_values),
        cmocka_unit_test(mistakes_are_named),       cmocka_unit_test(help_needs_nothing_else),
        cmocka_unit_test(ranges_count_from_zero),   cmocka_unit_test(numbers_are_checked),
        cmocka_unit_test(an_output_needs_a_folder),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
