// Texts with values: keys within lines, whole lines, and lines that are left out.
#include <stdlib.h>

#include "base/template.h"
#include "tests/support/unit.h"

static void write_two_lines(FILE *file, const void *context) {
    const char *text = context;
    fprintf(file, "%s\n%s\n", text, text);
}

static void write_word(FILE *file, const void *context) {
    fputs(context, file);
}

static void values_replace_their_keys(void **state) {
    (void)state;
    static const char *const lines[] = {
        "%A%b%A% 100 % %UNKNOWN%\n", "%LINES%\n", "%GONE%x\n", "<%WORD%>\n", "not written\n", NULL};
    const pm_template_value value[] = {{"%A%", .text = "a"},
                                       {"%LINES%", .write = write_two_lines, .context = "line"},
                                       {"%WORD%", .write = write_word, .context = "word"},
                                       {"%GONE%", .text = NULL}};
    char *text = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&text, &size);
    assert_non_null(file);
    pm_template_write(file, lines, 4, 4, value);
    assert_int_equal(fclose(file), 0);
    assert_string_equal(text, "aba 100 % %UNKNOWN%\nline\nline\n<word>\n");
    free(text);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_replace_their_keys),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
