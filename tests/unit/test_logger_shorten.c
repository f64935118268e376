// Formulas without names that stand for zero.
#include "propose/logger_shorten.h"
#include "tests/support/unit.h"

static const char *const zero[] = {"z", "y"};

static void what_is_zero_vanishes(void **state) {
    (void)state;
    static const char *const cases[][2] = {
        {"(0 + 1*z*(x/2)^1)*a", "0"},
        {"(a + z*|x|/3)*exp(0 + z*sin(x))", "a"},
        {"exp(-(0 + z))*(a*b.dE.s)", "a*b.dE.s"},
        {"(1 + 3*sin(z))*c", "c"},
        {"a - (b - c)", "a - (b - c)"},
        {"a*(b*c)", "a*(b*c)"},
        {"a/(b/c)", "a/(b/c)"},
        {"z - b*c", "-(b*c)"},
        {"a*-b", "a*(-b)"},
        {"-a^2 + (-a)^2", "-a^2 + (-a)^2"},
        {"(x[1] + z)^(2)", "x[1]^2"},
        {"(z + 2)*(3 + y)*a", "6*a"},
        {"|min(x,0)|^2*k/2 + y", "|min(x,0)|^2*k/2"},
        {"<q,p>/(m + y)", "<q,p>/m"},
        {"az*zz + z", "az*zz"},
        {"1e+06*a + 1.5e-3", "1e+06*a + 1.5e-3"},
        {"sqrt((x - (0.3 + 0.2*sin(y)))^2 + w^2)", "sqrt((x - 0.3)^2 + w^2)"},
    };
    pm_arena arena = {0};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const char *line = pm_arena_printf(&arena, "[a, b, \"%s\"]\n", cases[i][0]);
        const char *brief = pm_arena_printf(&arena, "[a, b, \"%s\"]\n", cases[i][1]);
        assert_string_equal(pm_logger_shorten(&arena, line, 2, zero), brief);
    }
    pm_arena_free(&arena);
}

// A text that is no formula, or that has no value without the names, stays as it is.
static void the_rest_stays(void **state) {
    (void)state;
    static const char *const cases[] = {"", "scene.yaml of a", "(a", "a b", "a/z", "ln(z)", "|x"};
    pm_arena arena = {0};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const char *line = pm_arena_printf(&arena, "[\"%s\", x]\n", cases[i]);
        assert_string_equal(pm_logger_shorten(&arena, line, 2, zero), line);
    }
    assert_true(pm_logger_mentions("a*width_x", "width_x"));
    assert_false(pm_logger_mentions("a*width_x_1 + b.width_x", "width_x"));
    pm_arena_free(&arena);
}

// Terms of a list vanish, but for the last one.
static void terms_vanish(void **state) {
    (void)state;
    static const char terms[] =
        "    energy:\n      - \"z*x\"\n      - \"a*x\"   # why\n      - \"y\"\n"
        "    coenergy:\n      - \"z*x\"\n      - \"y*x\"\n    law: b\n";
    static const char left[] = "    energy:\n      - \"a*x\"   # why\n"
                               "    coenergy:\n      - \"0\"\n    law: b\n";
    pm_arena arena = {0};
    assert_string_equal(pm_logger_shorten(&arena, terms, 2, zero), left);
    pm_arena_free(&arena);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_zero_vanishes),
        cmocka_unit_test(the_rest_stays),
        cmocka_unit_test(terms_vanish),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
