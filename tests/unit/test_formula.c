// Values and derivatives of formulas are compared with the same expressions in C, discrete
// derivatives satisfy their defining equations, and every mistake in the text is refused.
#include <math.h>
#include <string.h>

#include "graph/program.h"
#include "model/formula.h"
#include "tests/support/unit.h"

#define NZ 5

static const pm_layout layout = {3,
                                 (pm_group[]){{"q", "m", 2, 0, PM_ROLE_OTHER, false},
                                              {"p", "kg m/s", 2, 2, PM_ROLE_OTHER, false},
                                              {"s", "J/K", 1, 4, PM_ROLE_ENTROPY, false}},
                                 NZ};
static const double before[NZ] = {3, -4, 0.5, 2, -0.25}, after[NZ] = {2.5, -3, 0.8, 2.5, 0.5};

static const char *const constant_names[] = {"C", "l0", "c", "Tr"};
static const double constant_values[] = {0.2, 2, 5.08, 300};
static const pm_constants constants = {
    .count = 4, .name = constant_names, .value = constant_values};

static pm_formula formula_of(const char *text) {
    return (pm_formula){text, &constants, "t.yaml:3:7"};
}

static pm_symbols symbols_of(pm_graph *g, pm_node z) {
    pm_symbols symbols = {0};
    pm_symbols_add(&symbols, g, &layout, "", z);
    return symbols;
}

static void check(const char *what, double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance * (1 + fabs(expected)))) {
        fail_msg("%s: %.17g, expected %.17g within %g", what, value, expected, tolerance);
    }
}

// Computes the value and the gradient of a formula at z.
static double evaluate(const char *text, const double *z, double gradient[NZ]) {
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node state = pm_input(g, true, 1, NZ);
    const pm_symbols symbols = symbols_of(g, state);
    const pm_formula formula = formula_of(text);
    if (pm_formula_check(&formula, &symbols) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    pm_node node[2] = {pm_formula_build(g, &formula, &symbols), PM_NO_NODE};
    pm_gradient(g, node[0], PM_NO_NODE, 1, &state, &node[1]);
    pm_program *p = NULL;
    assert_int_equal(pm_program_open(&p, g, node[1] == PM_NO_NODE ? 1 : 2, node, 1), PM_OK);
    memcpy(pm_program_value(p, state), z, NZ * sizeof *z);
    pm_program_run(p, 1);
    for (int i = 0; i < NZ; ++i) {
        gradient[i] = node[1] == PM_NO_NODE ? 0 : pm_program_value(p, node[1])[i];
    }
    const double value = *pm_program_value(p, node[0]);
    pm_program_close(p);
    pm_graph_close(g);
    return value;
}

static void discrete_gradient(const char *text, const double *from, const double *to,
                              double gradient[NZ]) {
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z[2] = {pm_input(g, true, 1, NZ), pm_input(g, true, 1, NZ)};
    const pm_symbols a = symbols_of(g, z[0]), b = symbols_of(g, z[1]);
    const pm_formula formula = formula_of(text);
    pm_node covector[PM_MAX_SYMBOLS], sum = pm_constant(g, 0, 1, NZ);
    for (int i = 0; i < a.count; ++i) {
        covector[i] = PM_NO_NODE;
    }
    pm_formula_discrete(g, &formula, &a, &b, covector);
    for (int i = 0; i < layout.ngroup; ++i) {
        if (covector[i] != PM_NO_NODE) {
            sum = pm_add(g, sum, pm_place(g, covector[i], layout.group[i].first, NZ));
        }
    }
    sum = pm_broadcast_to(g, sum, (pm_shape){true, 1, NZ});
    pm_program *p = NULL;
    const pm_node outputs[] = {sum};
    assert_int_equal(pm_program_open(&p, g, 1, outputs, 1), PM_OK);
    memcpy(pm_program_value(p, z[0]), from, NZ * sizeof *from);
    memcpy(pm_program_value(p, z[1]), to, NZ * sizeof *to);
    pm_program_run(p, 1);
    memcpy(gradient, pm_program_value(p, sum), NZ * sizeof *gradient);
    pm_program_close(p);
    pm_graph_close(g);
}

// At `before`: |q| = 5, |p|^2 = 4.25, <q,p> = -6.5.
static const struct {
    const char *text;
    double value;
} cases[] = {
    {"2", 2},
    {"2 + 3*4 - 6/4", 12.5},
    {"-2^2", -4},
    {"2^-1 + (-2)^3 + 2^0", -6.5},
    {"1 - 2 - 3", -4},
    {"16/4/2", 2},
    {"2^3^2", 512},
    {".5e1", 5},
    {"sqrt(16) + exp(0) + ln(1)", 5},
    {"sin(s) + cos(2*s)", 0.6301786026358498},
    {"s", -0.25},
    {"-s", 0.25},
    {"C", 0.2},
    {"q[0] + 10*q[ 1 ]", -37},
    {"|p|^2/(2*l0)", 1.0625},
    {"|q|", 5},
    {"(|q|/l0)^2", 6.25},
    {"|q|^3 - |q|", 120},
    {"< q , p >", -6.5},
    {"|min(q,0)|^2/C", 80},
    {"|min(s,0)|^2 + 3*|min(p,0)|^2", 0.0625},
    {"|min( q, 0 )|^2.5 - |min(q,0)|", 28},
    {"|min(q - p, 0)|^2", 36},
    {"C*|min(p*q/s + l0,0)|^2 - |min(2*s*p + exp(s)*q - p[1], 0)|^2", -34.19570934911585},
    {"s^2*s", -0.015625},
    {"s^-1", -4},
    {"q[0]^-2", 1.0 / 9},
    {"q[0]^1", 3},
    {"q[0]^0", 1},
    {"|q|^(-2/3)", 0.3419951893353394},
    {"|q|^17/1e11", 7.62939453125},
    {"1/(1 + exp(-s))", 0.43782349911420193},
    {"C/2*ln(|q|/l0)^2", 0.08395887053184749},
    {"c*Tr*(exp((s - C*ln(|q|/l0))/c) - 1)", -124.58901851969007},
    {"sqrt(|q|) + (s + 1)*(s + 2)/|p|^2", 2.5448915069115543},
    {"(s + 2)/(q[0] - s)*|q|", 2.6923076923076925},
};
#define CASES (sizeof cases / sizeof *cases)

static void values_and_derivatives(void **state) {
    (void)state;
    for (size_t i = 0; i < CASES; ++i) {
        const char *text = cases[i].text;
        double gradient[NZ], ignored[NZ];
        check(text, evaluate(text, before, gradient), cases[i].value, 1e-14);
        for (int c = 0; c < NZ; ++c) {
            const double h = 1e-6;
            double up[NZ], down[NZ];
            memcpy(up, before, sizeof up);
            memcpy(down, before, sizeof down);
            up[c] += h;
            down[c] -= h;
            const double difference =
                (evaluate(text, up, ignored) - evaluate(text, down, ignored)) / (2 * h);
            check(text, gradient[c], difference, 1e-7);
        }
    }
}

// D(x, y) . (y - x) = f(y) - f(x), D(x, y) = D(y, x), and D(x, x) is the derivative.
static void discrete_derivatives(void **state) {
    (void)state;
    for (size_t i = 0; i < CASES; ++i) {
        const char *text = cases[i].text;
        double forth[NZ], back[NZ], same[NZ], gradient[NZ], change = 0;
        discrete_gradient(text, before, after, forth);
        discrete_gradient(text, after, before, back);
        discrete_gradient(text, before, before, same);
        const double rise = evaluate(text, after, gradient) - evaluate(text, before, gradient);
        for (int c = 0; c < NZ; ++c) {
            change += forth[c] * (after[c] - before[c]);
            check(text, forth[c], back[c], 1e-13);
            check(text, same[c], gradient[c], 1e-13);
        }
        check(text, change, rise, 1e-12);
    }
}

// A symbol without a value counts as zero, such as the dS of a part without entropy.
static void absent_covectors_are_zero(void **state) {
    (void)state;
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    pm_symbols symbols = {0};
    pm_symbols_add(&symbols, g, &layout, "dS.", PM_NO_NODE);
    const pm_formula formula = formula_of("1 + dS.s");
    assert_int_equal(pm_formula_check(&formula, &symbols), PM_OK);
    const pm_node node = pm_formula_build(g, &formula, &symbols);
    pm_program *p = NULL;
    assert_int_equal(pm_program_open(&p, g, 1, &node, 1), PM_OK);
    pm_program_run(p, 1);
    assert_true(*pm_program_value(p, node) == 1);
    pm_program_close(p);
    pm_graph_close(g);
}

static void mentions(void **state) {
    (void)state;
    const pm_formula formula = formula_of("ss + b.dE.s*q_1 + |p|");
    assert_true(pm_formula_mentions(&formula, "s"));
    assert_true(pm_formula_mentions(&formula, "p"));
    assert_false(pm_formula_mentions(&formula, "q"));
    assert_false(pm_formula_mentions(&formula, "d"));
}

#define TEN "s+s+s+s+s+s+s+s+s+s+"
#define HUNDRED TEN TEN TEN TEN TEN TEN TEN TEN TEN TEN
#define THOUSAND HUNDRED HUNDRED HUNDRED HUNDRED HUNDRED HUNDRED HUNDRED HUNDRED HUNDRED HUNDRED

static void mistakes_are_told(void **state) {
    (void)state;
    static const char *const bad[][2] = {
        {"", "expected a number, a name or a bracket at its end"},
        {"1 +", "expected a number, a name or a bracket at its end"},
        {"1 2", "expected an operation at \"2\""},
        {"(1 + s", "expected \")\" at its end"},
        {"|q", "expected \"|\" at its end"},
        {"|min(q)|", "expected \",0)\" at \")|\""},
        {"|min(q,1)|", "expected \",0)\" at \"1)|\""},
        {"|min(q,0)", "expected \"|\" at its end"},
        {"|min(q + C,0)|", "expected \",0)|^2\" at its end"},
        {"|min(q + u,0)|^2", "there is no \"u\" here"},
        {"|min(q + r,0)|^2", "vectors of 2 and 3 components"},
        {"|min(q + C,0)|^2 + q", "q is a vector"},
        {"|max(q,0)|", "expected \"|\" at \"(q,0)|\""},
        {"<q;p>", "expected \",\" at \";p>\""},
        {"<q,p", "expected \">\" at its end"},
        {"<q,s>", "do not fit together"},
        {"x + 1", "there is no \"x\" here, only q, p, s"},
        {"tan(s)", "there is no function \"tan\", only exp, ln, sqrt, sin, cos"},
        {"q + 1", "q is a vector; expected q[0], |q|, ..."},
        {"q[2]", "q has 2 components, the first is q[0]"},
        {"q[x]", "expected the number of a component at \"x]\""},
        {"q[1234567]", "expected the number of a component"},
        {"q[1", "expected \"]\" at its end"},
        {"2^s", "an exponent must be a number"},
        {"1/0", "an operation on numbers gives inf"},
        {"ln(-1)", "nan"},
        {"1e999", "expected a finite number at \"1e999\""},
        {"s $ 2", "expected an operation at \"$ 2\""},
        {"((((((((((((((((((((((((((((((((s))))))))))))))))))))))))))))))))",
         "more than 32 brackets and signs in one another"},
        {THOUSAND "s", "more than 2000 operations"},
    };
    pm_symbols symbols = symbols_of(NULL, PM_NO_NODE);
    symbols.symbol[symbols.count++] =
        (pm_symbol){.name = "r", .size = 3, .node = PM_NO_NODE, .radians = 1};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        const pm_formula formula = formula_of(bad[i][0]);
        assert_int_equal(pm_formula_check(&formula, &symbols), PM_ECONFIG);
        if (strstr(pm_error(), bad[i][1]) == NULL ||
            strncmp(pm_error(), "t.yaml:3:7: ", strlen("t.yaml:3:7: ")) != 0) {
            fail_msg("%s: \"%s\", expected \"%s\"", bad[i][0], pm_error(), bad[i][1]);
        }
    }
    static const char *const name[] = {"s"};
    static const double value[] = {1};
    const pm_constants clash = {.count = 1, .name = name, .value = value};
    const pm_formula formula = {"s", &clash, NULL};
    assert_int_equal(pm_formula_check(&formula, &symbols), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "constant \"s\" has the name of a group"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_and_derivatives),    cmocka_unit_test(discrete_derivatives),
        cmocka_unit_test(absent_covectors_are_zero), cmocka_unit_test(mentions),
        cmocka_unit_test(mistakes_are_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
