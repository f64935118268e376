// Reads formulas into steps by recursive descent (sum, product, sign, power, operand), and builds
// their values and discrete derivatives.
#include <assert.h>
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/formula_steps.h"

#define MAX_DEPTH 32 // brackets and signs within one another
#define MAX_WHOLE 16 // largest integer exponent that becomes products

// --- reading ---

typedef struct formula_reader {
    const pm_formula *formula;
    const pm_symbols *symbols;
    const char *at; // the text that remains to be read
    int depth;
    bool vectors; // a vector may stand here, inside |min(...,0)|^2
    pm_formula_steps *steps;
} formula_reader;

static pm_status fail(const formula_reader *r, const char *expected) {
    const bool end = *r->at == '\0';
    return pm_fail(PM_ECONFIG, "formula \"%.100s\": expected %s at %s%.20s%s", r->formula->text,
                   expected, end ? "its end" : "\"", r->at, end ? "" : "\"");
}

static void skip_blanks(formula_reader *r) {
    r->at += strspn(r->at, " ");
}

static bool take(formula_reader *r, char c) {
    skip_blanks(r);
    if (*r->at != c) {
        return false;
    }
    ++r->at;
    return true;
}

static pm_status add_step(formula_reader *r, pm_step s, int *result) {
    if (r->steps->count == PM_MAX_STEPS) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": more than %d operations", r->formula->text,
                       PM_MAX_STEPS);
    }
    r->steps->step[r->steps->count] = s;
    *result = r->steps->count++;
    return PM_OK;
}

// The functions of one number, by the kind of their steps: name, value and graph.
static const struct {
    const char *name;
    double (*compute)(double x);
    pm_node (*build)(pm_graph *g, pm_node x);
} functions[] = {[PM_STEP_EXP] = {"exp", exp, pm_exp},
                 [PM_STEP_LN] = {"ln", log, pm_log},
                 [PM_STEP_SQRT] = {"sqrt", sqrt, pm_sqrt},
                 [PM_STEP_SIN] = {"sin", sin, pm_sin},
                 [PM_STEP_COS] = {"cos", cos, pm_cos}};

static double compute(pm_step_kind kind, double a, double b) {
    return kind == PM_STEP_ADD        ? a + b
           : kind == PM_STEP_SUBTRACT ? a - b
           : kind == PM_STEP_MULTIPLY ? a * b
           : kind == PM_STEP_DIVIDE   ? a / b
                                      : functions[kind].compute(a);
}

// Adds an operation. An operation on two numbers becomes a number.
static pm_status add_operation(formula_reader *r, pm_step_kind kind, int a, int b, int *result) {
    const int width = r->steps->step[a].width, other = r->steps->step[b].width;
    pm_step s = {.kind = kind, .width = width > other ? width : other, .a = a, .b = b};
    if (width != other && width != 1 && other != 1) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": vectors of %d and %d components",
                       r->formula->text, width, other);
    }
    if (r->steps->step[a].kind == PM_STEP_NUMBER && r->steps->step[b].kind == PM_STEP_NUMBER) {
        s.kind = PM_STEP_NUMBER;
        s.number = compute(kind, r->steps->step[a].number, r->steps->step[b].number);
        if (!isfinite(s.number)) {
            return pm_fail(
                PM_ECONFIG,
                "formula \"%.100s\": an operation on numbers gives %g, expected a finite number",
                r->formula->text, s.number);
        }
    }
    return add_step(r, s, result);
}

static pm_status read_sum(formula_reader *r, int *result);

static bool is_name_character(char c) {
    return isalnum((unsigned char)c) || c == '_' || c == '.';
}

static pm_status read_name(formula_reader *r, char name[PM_MAX_NAME]) {
    size_t length = 0;
    skip_blanks(r);
    while (is_name_character(r->at[length])) {
        ++length;
    }
    if (length == 0 || length >= PM_MAX_NAME || !isalpha((unsigned char)*r->at)) {
        return fail(r, "a number, a name or a bracket");
    }
    memcpy(name, r->at, length);
    name[length] = '\0';
    r->at += length;
    return PM_OK;
}

static pm_status add_feature(formula_reader *r, pm_step s, int *result) {
    PM_TRY(pm_feature_size(s.feature, r->symbols, &s.size));
    if (s.component >= s.size) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": %s has %d components, the first is %s[0]",
                       r->formula->text, s.feature, s.size, s.feature);
    }
    s.width = s.component == PM_STEP_WHOLE ? s.size : 1;
    return add_step(r, s, result);
}

// Returns true if the text up to the next comma, bracket or end is one name.
static bool is_lone_name(const char *at) {
    at += strspn(at, " ");
    const bool name = isalpha((unsigned char)*at);
    while (is_name_character(*at)) {
        ++at;
    }
    at += strspn(at, " ");
    return name && (*at == ',' || *at == ')' || *at == '\0');
}

// Reads the remainder of |min(<sum>, 0)|^2 after "|min(".
static pm_status read_negative_squared(formula_reader *r, int *result) {
    const bool outer = r->vectors;
    pm_step s = {.kind = PM_STEP_NEGATIVE_SQUARED, .width = 1};
    r->vectors = true;
    PM_TRY(read_sum(r, &s.a));
    r->vectors = outer;
    s.b = s.a;
    if (!take(r, ',') || !take(r, '0') || !take(r, ')') || !take(r, '|') || !take(r, '^') ||
        !take(r, '2')) {
        return fail(r, "\",0)|^2\"");
    }
    return add_step(r, s, result);
}

// Reads |x|, |min(x,0)| or <x,y> as a feature. read_power turns the square of the first two into
// the feature of the square, which is smooth.
static pm_status read_invariant(formula_reader *r, int *result) {
    char x[PM_MAX_NAME], y[PM_MAX_NAME];
    pm_step s = {.kind = PM_STEP_FEATURE};
    const bool norm = *r->at++ == '|';
    PM_TRY(read_name(r, x));
    const bool negative = norm && strcmp(x, "min") == 0 && take(r, '(');
    if (negative) {
        if (!is_lone_name(r->at)) {
            return read_negative_squared(r, result);
        }
        PM_TRY(read_name(r, x));
        if (!take(r, ',') || !take(r, '0') || !take(r, ')')) {
            return fail(r, "\",0)\"");
        }
    }
    if (norm) {
        if (!take(r, '|')) {
            return fail(r, "\"|\"");
        }
        snprintf(s.feature, sizeof s.feature, negative ? "|min(%s,0)|" : "|%s|", x);
        return add_feature(r, s, result);
    }
    if (!take(r, ',')) {
        return fail(r, "\",\"");
    }
    PM_TRY(read_name(r, y));
    if (!take(r, '>')) {
        return fail(r, "\">\"");
    }
    snprintf(s.feature, sizeof s.feature, "<%s,%s>", x, y);
    return add_feature(r, s, result);
}

static pm_status read_bracket(formula_reader *r, int *result) {
    PM_TRY(read_sum(r, result));
    return take(r, ')') ? PM_OK : fail(r, "\")\"");
}

// Returns false for a learned constant, which is a symbol (constants.h).
static bool is_known(const pm_constants *constants, int i) {
    return constants->learned == NULL || constants->learned[i] == PM_CONSTANT_KNOWN;
}

static pm_status read_named(formula_reader *r, int *result) {
    const pm_constants *constants = r->formula->constants;
    pm_step s = {.kind = PM_STEP_FEATURE};
    PM_TRY(read_name(r, s.feature));
    if (take(r, '(')) {
        for (int kind = PM_STEP_EXP; kind <= PM_STEP_COS; ++kind) {
            if (strcmp(s.feature, functions[kind].name) == 0) {
                int argument = 0;
                PM_TRY(read_bracket(r, &argument));
                return add_operation(r, (pm_step_kind)kind, argument, argument, result);
            }
        }
        return pm_fail(
            PM_ECONFIG,
            "formula \"%.100s\": there is no function \"%s\", only exp, ln, sqrt, sin, cos",
            r->formula->text, s.feature);
    }
    for (int i = 0; constants != NULL && i < constants->count; ++i) {
        if (is_known(constants, i) && strcmp(s.feature, constants->name[i]) == 0) {
            const pm_step number = {
                .kind = PM_STEP_NUMBER, .width = 1, .number = constants->value[i]};
            return add_step(r, number, result);
        }
    }
    PM_TRY(pm_feature_size(s.feature, r->symbols, &s.size));
    if (take(r, '[')) {
        skip_blanks(r);
        const size_t digits = strspn(r->at, "0123456789");
        if (digits == 0 || digits > 6) {
            return fail(r, "the number of a component");
        }
        s.component = atoi(r->at);
        r->at += digits;
        if (!take(r, ']')) {
            return fail(r, "\"]\"");
        }
    } else if (s.size > 1 && r->vectors) {
        s.component = PM_STEP_WHOLE;
    } else if (s.size > 1) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": %s is a vector; expected %s[0], |%s|, ...",
                       r->formula->text, s.feature, s.feature, s.feature);
    }
    return add_feature(r, s, result);
}

static pm_status read_operand(formula_reader *r, int *result) {
    skip_blanks(r);
    if (isdigit((unsigned char)*r->at) || *r->at == '.') {
        char *end;
        const pm_step s = {.kind = PM_STEP_NUMBER, .width = 1, .number = strtod(r->at, &end)};
        if (!isfinite(s.number)) {
            return fail(r, "a finite number");
        }
        r->at = end;
        return add_step(r, s, result);
    }
    if (*r->at == '|' || *r->at == '<') {
        return read_invariant(r, result);
    }
    return take(r, '(') ? read_bracket(r, result) : read_named(r, result);
}

// Adds base^exponent: products for small integers, else exp(exponent ln(base)).
static pm_status add_power(formula_reader *r, int base, double exponent, int *result) {
    const int whole = fabs(exponent) <= MAX_WHOLE ? (int)exponent : 0;
    pm_step number = {.kind = PM_STEP_NUMBER, .width = 1, .number = 1};
    if (whole != exponent) {
        number.number = exponent;
        PM_TRY(add_operation(r, PM_STEP_LN, base, base, &base));
        PM_TRY(add_step(r, number, result));
        PM_TRY(add_operation(r, PM_STEP_MULTIPLY, *result, base, result));
        return add_operation(r, PM_STEP_EXP, *result, *result, result);
    }
    int power = base;
    for (int i = 1; i < abs(whole); ++i) {
        PM_TRY(add_operation(r, PM_STEP_MULTIPLY, power, base, &power));
    }
    if (whole > 0) {
        *result = power;
        return PM_OK;
    }
    PM_TRY(add_step(r, number, result));
    return whole == 0 ? PM_OK : add_operation(r, PM_STEP_DIVIDE, *result, power, result);
}

static pm_status read_signed(formula_reader *r, int *result);

static pm_status read_power(formula_reader *r, int *result) {
    int exponent = 0;
    PM_TRY(read_operand(r, result));
    if (!take(r, '^')) {
        return PM_OK;
    }
    PM_TRY(read_signed(r, &exponent));
    const pm_step *e = &r->steps->step[exponent], *base = &r->steps->step[*result];
    if (e->kind != PM_STEP_NUMBER) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": an exponent must be a number",
                       r->formula->text);
    }
    if (e->number == 2 && base->kind == PM_STEP_FEATURE && base->feature[0] == '|') {
        pm_step square = *base;
        strcat(square.feature, "^2");
        return add_feature(r, square, result);
    }
    return add_power(r, *result, e->number, result);
}

static pm_status read_signed(formula_reader *r, int *result) {
    if (++r->depth > MAX_DEPTH) {
        return pm_fail(PM_ECONFIG,
                       "formula \"%.100s\": more than %d brackets and signs in one "
                       "another",
                       r->formula->text, MAX_DEPTH);
    }
    if (take(r, '-')) {
        int minus = 0;
        const pm_step number = {.kind = PM_STEP_NUMBER, .width = 1, .number = -1};
        PM_TRY(add_step(r, number, &minus));
        PM_TRY(read_signed(r, result));
        PM_TRY(add_operation(r, PM_STEP_MULTIPLY, minus, *result, result));
    } else {
        PM_TRY(read_power(r, result));
    }
    --r->depth;
    return PM_OK;
}

static pm_status read_product(formula_reader *r, int *result) {
    PM_TRY(read_signed(r, result));
    for (;;) {
        const bool times = take(r, '*');
        int other = 0;
        if (!times && !take(r, '/')) {
            return PM_OK;
        }
        PM_TRY(read_signed(r, &other));
        PM_TRY(add_operation(r, times ? PM_STEP_MULTIPLY : PM_STEP_DIVIDE, *result, other, result));
    }
}

static pm_status read_sum(formula_reader *r, int *result) {
    PM_TRY(read_product(r, result));
    for (;;) {
        const bool plus = take(r, '+');
        int other = 0;
        if (!plus && !take(r, '-')) {
            return PM_OK;
        }
        PM_TRY(read_product(r, &other));
        PM_TRY(add_operation(r, plus ? PM_STEP_ADD : PM_STEP_SUBTRACT, *result, other, result));
    }
}

static pm_status read_formula(pm_formula_steps *steps, const pm_formula *formula,
                              const pm_symbols *symbols) {
    formula_reader r = {
        .formula = formula, .symbols = symbols, .at = formula->text, .steps = steps};
    const pm_constants *constants = formula->constants;
    for (int i = 0; constants != NULL && i < constants->count; ++i) {
        int count = is_known(constants, i) ? 1 : 0; // a learned one is a symbol itself
        for (int k = 0; k < symbols->count; ++k) {
            const bool same = strcmp(constants->name[i], symbols->symbol[k].name) == 0;
            count += same;
            if (same && count > 1) {
                return pm_fail(PM_ECONFIG, "constant \"%s\" has the name of a group",
                               constants->name[i]);
            }
        }
    }
    steps->count = 0;
    PM_TRY(read_sum(&r, &steps->whole));
    skip_blanks(&r);
    return *r.at == '\0' ? PM_OK : fail(&r, "an operation");
}

pm_status pm_formula_check(const pm_formula *formula, const pm_symbols *symbols) {
    pm_formula_steps steps;
    return pm_spec_locate(formula->at, read_formula(&steps, formula, symbols));
}

void pm_formula_read_again(pm_formula_steps *steps, const pm_formula *formula,
                           const pm_symbols *symbols) {
    const pm_status status = read_formula(steps, formula, symbols);
    assert(status == PM_OK);
    (void)status;
}

bool pm_formula_mentions(const pm_formula *formula, const char *group) {
    return pm_feature_mentions(formula->text, group);
}

// --- building ---

static pm_node build_step(pm_graph *g, const pm_step *s, const pm_symbols *symbols,
                          const pm_node *value) {
    switch (s->kind) {
    case PM_STEP_NUMBER:
        return pm_constant(g, s->number, 1, 1);
    case PM_STEP_FEATURE:
        return s->component == PM_STEP_WHOLE
                   ? pm_feature_build(g, s->feature, symbols)
                   : pm_slice(g, pm_feature_build(g, s->feature, symbols), s->component, 1);
    case PM_STEP_ADD:
        return pm_add(g, value[s->a], value[s->b]);
    case PM_STEP_SUBTRACT:
        return pm_sub(g, value[s->a], value[s->b]);
    case PM_STEP_MULTIPLY:
        return pm_mul(g, value[s->a], value[s->b]);
    case PM_STEP_DIVIDE:
        return pm_div(g, value[s->a], value[s->b]);
    case PM_STEP_NEGATIVE_SQUARED: {
        const pm_node negative = pm_mul(g, value[s->a], pm_is_negative(g, value[s->a]));
        return pm_dot(g, negative, negative);
    }
    default:
        return functions[s->kind].build(g, value[s->a]);
    }
}

void pm_formula_build_steps(pm_graph *g, const pm_formula_steps *steps, const pm_symbols *symbols,
                            pm_node *value) {
    for (int i = 0; i < steps->count; ++i) {
        value[i] = build_step(g, &steps->step[i], symbols, value);
    }
}

pm_node pm_formula_build(pm_graph *g, const pm_formula *formula, const pm_symbols *symbols) {
    pm_formula_steps steps;
    pm_node value[PM_MAX_STEPS];
    pm_formula_read_again(&steps, formula, symbols);
    pm_formula_build_steps(g, &steps, symbols, value);
    return value[steps.whole];
}

// --- discrete derivatives ---

static pm_node mean(pm_graph *g, pm_node from, pm_node to) {
    return pm_scale(g, pm_add(g, from, to), 0.5);
}

// Computes the slopes of a step between two states: change = slope[0] change_a + slope[1] change_b.
static void divided_difference(pm_graph *g, const pm_step *s, pm_node own_from, pm_node own_to,
                               const pm_node *from, const pm_node *to, pm_node slope[2]) {
    const pm_node one = pm_constant(g, 1, 1, 1);
    const pm_node a_from = from[s->a], a_to = to[s->a], b_from = from[s->b], b_to = to[s->b];
    slope[0] = one;
    slope[1] = PM_NO_NODE;
    switch (s->kind) {
    case PM_STEP_ADD:
        slope[1] = one;
        break;
    case PM_STEP_SUBTRACT:
        slope[1] = pm_constant(g, -1, 1, 1);
        break;
    case PM_STEP_MULTIPLY:
        slope[0] = mean(g, b_from, b_to);
        slope[1] = mean(g, a_from, a_to);
        break;
    case PM_STEP_DIVIDE:
        slope[0] = mean(g, pm_div(g, one, b_from), pm_div(g, one, b_to));
        slope[1] = pm_scale(g, pm_div(g, mean(g, a_from, a_to), pm_mul(g, b_from, b_to)), -1);
        break;
    case PM_STEP_EXP:
        slope[0] = pm_div(g, one, pm_inverse_logarithmic_mean(g, own_from, own_to));
        break;
    case PM_STEP_LN:
        slope[0] = pm_inverse_logarithmic_mean(g, a_from, a_to);
        break;
    case PM_STEP_SQRT:
        slope[0] = pm_div(g, one, pm_add(g, own_from, own_to));
        break;
    case PM_STEP_SIN:
    case PM_STEP_COS:
        slope[0] = pm_trigonometric_difference(g, s->kind == PM_STEP_SIN, a_from, a_to);
        break;
    case PM_STEP_NEGATIVE_SQUARED:
        slope[0] = pm_negative_squared_slope(g, a_from, a_to);
        break;
    case PM_STEP_NUMBER:
    case PM_STEP_FEATURE:
        break;
    }
}

void pm_formula_discrete(pm_graph *g, const pm_formula *formula, const pm_symbols *from,
                         const pm_symbols *to, pm_node *covector) {
    pm_formula_steps steps;
    pm_node before[PM_MAX_STEPS], after[PM_MAX_STEPS], weight[PM_MAX_STEPS];
    pm_formula_read_again(&steps, formula, from);
    pm_formula_build_steps(g, &steps, from, before);
    pm_formula_build_steps(g, &steps, to, after);
    for (int i = 0; i < steps.count; ++i) {
        weight[i] = i == steps.whole ? pm_constant(g, 1, 1, 1) : PM_NO_NODE;
    }
    for (int i = steps.whole; i >= 0; --i) {
        const pm_step *s = &steps.step[i];
        if (weight[i] == PM_NO_NODE || s->kind == PM_STEP_NUMBER) {
            continue;
        }
        if (s->kind == PM_STEP_FEATURE) {
            const char *feature = s->feature;
            const pm_node placed = s->component == PM_STEP_WHOLE
                                       ? weight[i]
                                       : pm_place(g, weight[i], s->component, s->size);
            pm_features_discrete(g, 1, &feature, from, to, placed, covector);
            continue;
        }
        pm_node slope[2];
        divided_difference(g, s, before[i], after[i], before, after, slope);
        for (int k = 0; k < 2 && slope[k] != PM_NO_NODE; ++k) {
            const int operand = k == 0 ? s->a : s->b;
            // An operand of one component receives the sum of what its users pull.
            pm_node more = pm_mul(g, weight[i], slope[k]);
            if (steps.step[operand].width == 1) {
                more = pm_sum_to(g, more, (pm_shape){pm_graph_shape(g, more).batched, 1, 1});
            }
            weight[operand] = pm_add_or(g, weight[operand], more);
        }
    }
}
