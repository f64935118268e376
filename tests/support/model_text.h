// Reads models from the text of a `model:` block, and compares specs and parameters. Failures end
// the test.
#ifndef PM_TESTS_MODEL_TEXT_H
#define PM_TESTS_MODEL_TEXT_H

#include <string.h>

#include "model/part.h"
#include "scene/model_reader.h"
#include "tests/support/unit.h"

// Returns the spec of a part; it lives in the arena.
static inline pm_part_spec part_of(const char *text, pm_arena *arena) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_part_spec spec = {0};
    if (pm_yaml_parse(&document, text, "t.yaml", &root) != PM_OK ||
        pm_part_spec_read(root, (pm_yaml){0}, arena, &spec) != PM_OK) {
        fail_msg("%s in\n%s", pm_error(), text);
    }
    pm_yaml_close(document);
    return spec;
}

// Checks that the names, joined by blanks, are the expected text.
static inline void assert_names(int count, const char *const *names, const char *expected) {
    char joined[256] = "";
    for (int i = 0; i < count; ++i) {
        strcat(strcat(joined, i == 0 ? "" : " "), names[i]);
    }
    assert_string_equal(joined, expected);
}

// Checks that both hold the same parameters: names, shapes and bits of the values.
static inline void assert_same_params(const pm_params *a, const pm_params *b) {
    assert_int_equal(a->count, b->count);
    for (int i = 0; i < a->count; ++i) {
        const pm_param_entry *x = &a->entry[i], *y = &b->entry[i];
        assert_string_equal(x->name, y->name);
        assert_int_equal(x->rows, y->rows);
        assert_int_equal(x->cols, y->cols);
        assert_memory_equal(x->value, y->value, (size_t)(x->rows * x->cols) * sizeof *x->value);
    }
}

#endif
