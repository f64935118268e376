// Formulas are read into a list of steps, operands before what is made of them.
#include "model/formula.h"

#include <assert.h>
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_STEPS 128
#define MAX_DEPTH 32 // of brackets and signs
#define MAX_WHOLE 16 // exponents that are products
#define MAX_FEATURE (2 * PM_MAX_NAME + 8)

typedef enum step_kind {
    NUMBER,
    FEATURE, // component `component` of one
    ADD,
    SUBTRACT,
    MULTIPLY,
    DIVIDE,
    EXP,
    LN,
    SQRT,
    NEGATIVE_SQUARED // sum over the components
} step_kind;

#define WHOLE (-1) // a feature's component: all of them

typedef struct step {
    step_kind kind;
    int width; // components of the result
    int a, b;  // operands, by position
    double number;
    char feature[MAX_FEATURE];
    int component, size; // of the feature
} step;

typedef struct reader {
    const pm_formula *formula;
    const pm_symbols *symbols;
    const char *at;          // what is still to be read
    int depth, count, whole; // whole: position of the last operation
    bool vectors;            // are possible here
    step steps[MAX_STEPS];
} reader;

// --- reading ---

static pm_status fail(const reader *r, const char *expected) {
    const bool end = *r->at == '\0';
    return pm_fail(PM_ECONFIG, "formula \"%.100s\": expected %s at %s%.20s%s", r->formula->text,
                   expected, end ? "its end" : "\"", r->at, end ? "" : "\"");
}

static void skip_blanks(reader *r) {
    r->at += strspn(r->at, " ");
}

static bool take(reader *r, char c) {
    skip_blanks(r);
    if (*r->at != c) {
        return false;
    }
    ++r->at;
    return true;
}

static pm_status add_step(reader *r, step s, int *result) {
    if (r->count == MAX_STEPS) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": more than %d operations", r->formula->text,
                       MAX_STEPS);
    }
    r->steps[r->count] = s;
    *result = r->count++;
    return PM_OK;
}

static double compute(step_kind kind, double a, double b) {
    switch (kind) {
    case ADD:
        return a + b;
    case SUBTRACT:
        return a - b;
    case MULTIPLY:
        return a * b;
    case DIVIDE:
        return a / b;
    case EXP:
        return exp(a);
    case LN:
        return log(a);
    case SQRT:
        return sqrt(a);
    case NUMBER:
    case FEATURE:
    case NEGATIVE_SQUARED:
        break;
    }
    return NAN;
}

// Of numbers alone it is a number.
static pm_status add_operation(reader *r, step_kind kind, int a, int b, int *result) {
    const int width = r->steps[a].width, other = r->steps[b].width;
    step s = {.kind = kind, .width = width > other ? width : other, .a = a, .b = b};
    if (width != other && width != 1 && other != 1) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": vectors of %d and %d components",
                       r->formula->text, width, other);
    }
    if (r->steps[a].kind == NUMBER && r->steps[b].kind == NUMBER) {
        s.kind = NUMBER;
        s.number = compute(kind, r->steps[a].number, r->steps[b].number);
        if (!isfinite(s.number)) {
            return pm_fail(PM_ECONFIG, "formula \"%.100s\": a part of it is %g", r->formula->text,
                           s.number);
        }
    }
    return add_step(r, s, result);
}

static pm_status read_sum(reader *r, int *result);

static pm_status read_number(reader *r, int *result) {
    char *end;
    const step s = {.kind = NUMBER, .width = 1, .number = strtod(r->at, &end)};
    if (!isfinite(s.number)) {
        return fail(r, "a finite number");
    }
    r->at = end;
    return add_step(r, s, result);
}

static bool is_name_character(char c) {
    return isalnum((unsigned char)c) || c == '_' || c == '.';
}

static pm_status read_name(reader *r, char name[PM_MAX_NAME]) {
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

static pm_status add_feature(reader *r, step s, int *result) {
    PM_TRY(pm_feature_size(s.feature, r->symbols, &s.size));
    if (s.component >= s.size) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": %s has %d components, the first is %s[0]",
                       r->formula->text, s.feature, s.size, s.feature);
    }
    s.width = s.component == WHOLE ? s.size : 1;
    return add_step(r, s, result);
}

// Whether a name is all that stands before a comma, a bracket or the end.
static bool is_lone_name(const char *at) {
    at += strspn(at, " ");
    const bool name = isalpha((unsigned char)*at);
    while (is_name_character(*at)) {
        ++at;
    }
    at += strspn(at, " ");
    return name && (*at == ',' || *at == ')' || *at == '\0');
}

// After |min( of something else than a name: ..., 0)|^2.
static pm_status read_negative_squared(reader *r, int *result) {
    const bool outer = r->vectors;
    step s = {.kind = NEGATIVE_SQUARED, .width = 1};
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

// |x|, |min(x,0)| or <x,y>, as a feature; with a square the former, which are smooth.
static pm_status read_invariant(reader *r, int *result) {
    char x[PM_MAX_NAME], y[PM_MAX_NAME];
    step s = {.kind = FEATURE};
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

static pm_status read_bracket(reader *r, int *result) {
    PM_TRY(read_sum(r, result));
    return take(r, ')') ? PM_OK : fail(r, "\")\"");
}

static pm_status read_function(reader *r, const char *name, int *result) {
    static const struct {
        const char *name;
        step_kind kind;
    } functions[] = {{"exp", EXP}, {"ln", LN}, {"sqrt", SQRT}};
    for (size_t i = 0; i < sizeof functions / sizeof *functions; ++i) {
        if (strcmp(name, functions[i].name) == 0) {
            int argument = 0;
            PM_TRY(read_bracket(r, &argument));
            return add_operation(r, functions[i].kind, argument, argument, result);
        }
    }
    return pm_fail(PM_ECONFIG,
                   "formula \"%.100s\": there is no function \"%s\", only exp, ln, sqrt",
                   r->formula->text, name);
}

static pm_status read_named(reader *r, int *result) {
    const pm_constants *constants = r->formula->constants;
    step s = {.kind = FEATURE};
    PM_TRY(read_name(r, s.feature));
    if (take(r, '(')) {
        return read_function(r, s.feature, result);
    }
    for (int i = 0; constants != NULL && i < constants->count; ++i) {
        if (strcmp(s.feature, constants->name[i]) == 0) {
            const step number = {.kind = NUMBER, .width = 1, .number = constants->value[i]};
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
        s.component = WHOLE;
    } else if (s.size > 1) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": %s is a vector; expected %s[0], |%s|, ...",
                       r->formula->text, s.feature, s.feature, s.feature);
    }
    return add_feature(r, s, result);
}

static pm_status read_operand(reader *r, int *result) {
    skip_blanks(r);
    if (isdigit((unsigned char)*r->at) || *r->at == '.') {
        return read_number(r, result);
    }
    if (*r->at == '|' || *r->at == '<') {
        return read_invariant(r, result);
    }
    return take(r, '(') ? read_bracket(r, result) : read_named(r, result);
}

// base^exponent as products, or else as exp(exponent ln(base)).
static pm_status add_power(reader *r, int base, double exponent, int *result) {
    const int whole = fabs(exponent) <= MAX_WHOLE ? (int)exponent : 0;
    step number = {.kind = NUMBER, .width = 1, .number = 1};
    if (whole != exponent) {
        number.number = exponent;
        PM_TRY(add_operation(r, LN, base, base, &base));
        PM_TRY(add_step(r, number, result));
        PM_TRY(add_operation(r, MULTIPLY, *result, base, result));
        return add_operation(r, EXP, *result, *result, result);
    }
    int power = base;
    for (int i = 1; i < abs(whole); ++i) {
        PM_TRY(add_operation(r, MULTIPLY, power, base, &power));
    }
    if (whole > 0) {
        *result = power;
        return PM_OK;
    }
    PM_TRY(add_step(r, number, result));
    return whole == 0 ? PM_OK : add_operation(r, DIVIDE, *result, power, result);
}

static pm_status read_signed(reader *r, int *result);

static pm_status read_power(reader *r, int *result) {
    int exponent = 0;
    PM_TRY(read_operand(r, result));
    if (!take(r, '^')) {
        return PM_OK;
    }
    PM_TRY(read_signed(r, &exponent));
    const step *e = &r->steps[exponent], *base = &r->steps[*result];
    if (e->kind != NUMBER) {
        return pm_fail(PM_ECONFIG, "formula \"%.100s\": an exponent must be a number",
                       r->formula->text);
    }
    if (e->number == 2 && base->kind == FEATURE && base->feature[0] == '|') {
        step square = *base;
        strcat(square.feature, "^2");
        return add_feature(r, square, result);
    }
    return add_power(r, *result, e->number, result);
}

static pm_status read_signed(reader *r, int *result) {
    if (++r->depth > MAX_DEPTH) {
        return pm_fail(PM_ECONFIG,
                       "formula \"%.100s\": more than %d brackets and signs in one "
                       "another",
                       r->formula->text, MAX_DEPTH);
    }
    if (take(r, '-')) {
        int minus = 0;
        const step number = {.kind = NUMBER, .width = 1, .number = -1};
        PM_TRY(add_step(r, number, &minus));
        PM_TRY(read_signed(r, result));
        PM_TRY(add_operation(r, MULTIPLY, minus, *result, result));
    } else {
        PM_TRY(read_power(r, result));
    }
    --r->depth;
    return PM_OK;
}

static pm_status read_product(reader *r, int *result) {
    PM_TRY(read_signed(r, result));
    for (;;) {
        const bool times = take(r, '*');
        int other = 0;
        if (!times && !take(r, '/')) {
            return PM_OK;
        }
        PM_TRY(read_signed(r, &other));
        PM_TRY(add_operation(r, times ? MULTIPLY : DIVIDE, *result, other, result));
    }
}

static pm_status read_sum(reader *r, int *result) {
    PM_TRY(read_product(r, result));
    for (;;) {
        const bool plus = take(r, '+');
        int other = 0;
        if (!plus && !take(r, '-')) {
            return PM_OK;
        }
        PM_TRY(read_product(r, &other));
        PM_TRY(add_operation(r, plus ? ADD : SUBTRACT, *result, other, result));
    }
}

static pm_status check_constants(const reader *r) {
    const pm_constants *constants = r->formula->constants;
    for (int i = 0; constants != NULL && i < constants->count; ++i) {
        for (int k = 0; k < r->symbols->count; ++k) {
            if (strcmp(constants->name[i], r->symbols->symbol[k].name) == 0) {
                return pm_fail(PM_ECONFIG, "constant \"%s\" has the name of a group",
                               constants->name[i]);
            }
        }
    }
    return PM_OK;
}

static pm_status read_formula(reader *r, const pm_formula *formula, const pm_symbols *symbols) {
    *r = (reader){.formula = formula, .symbols = symbols, .at = formula->text};
    PM_TRY(check_constants(r));
    PM_TRY(read_sum(r, &r->whole));
    skip_blanks(r);
    return *r->at == '\0' ? PM_OK : fail(r, "an operation");
}

pm_status pm_formula_check(const pm_formula *formula, const pm_symbols *symbols) {
    reader r;
    return pm_spec_locate(formula->at, read_formula(&r, formula, symbols));
}

static void read_again(reader *r, const pm_formula *formula, const pm_symbols *symbols) {
    const pm_status status = read_formula(r, formula, symbols);
    assert(status == PM_OK);
    (void)status;
}

bool pm_formula_mentions(const pm_formula *formula, const char *group) {
    const size_t length = strlen(group);
    for (const char *at = formula->text; (at = strstr(at, group)) != NULL; ++at) {
        const bool begins =
            at == formula->text || (!isalnum((unsigned char)at[-1]) && at[-1] != '_');
        if (begins && !isalnum((unsigned char)at[length]) && at[length] != '_') {
            return true;
        }
    }
    return false;
}

// --- building ---

static pm_node build_step(pm_graph *g, const step *s, const pm_symbols *symbols,
                          const pm_node *value) {
    switch (s->kind) {
    case NUMBER:
        return pm_constant(g, s->number, 1, 1);
    case FEATURE:
        return s->component == WHOLE
                   ? pm_feature_build(g, s->feature, symbols)
                   : pm_slice(g, pm_feature_build(g, s->feature, symbols), s->component, 1);
    case ADD:
        return pm_add(g, value[s->a], value[s->b]);
    case SUBTRACT:
        return pm_sub(g, value[s->a], value[s->b]);
    case MULTIPLY:
        return pm_mul(g, value[s->a], value[s->b]);
    case DIVIDE:
        return pm_div(g, value[s->a], value[s->b]);
    case EXP:
        return pm_exp(g, value[s->a]);
    case LN:
        return pm_log(g, value[s->a]);
    case NEGATIVE_SQUARED:
        return pm_negative_squared(g, value[s->a]);
    case SQRT:
        break;
    }
    return pm_sqrt(g, value[s->a]);
}

static void build_steps(pm_graph *g, const reader *r, const pm_symbols *symbols, pm_node *value) {
    for (int i = 0; i < r->count; ++i) {
        value[i] = build_step(g, &r->steps[i], symbols, value);
    }
}

pm_node pm_formula_build(pm_graph *g, const pm_formula *formula, const pm_symbols *symbols) {
    reader r;
    pm_node value[MAX_STEPS];
    read_again(&r, formula, symbols);
    build_steps(g, &r, symbols, value);
    return value[r.whole];
}

// --- discrete derivatives ---

static pm_node mean(pm_graph *g, pm_node from, pm_node to) {
    return pm_scale(g, pm_add(g, from, to), 0.5);
}

// What a step's change is per change of its operands: change = slope_a change_a + slope_b change_b.
static void divided_difference(pm_graph *g, const step *s, pm_node own_from, pm_node own_to,
                               const pm_node *from, const pm_node *to, pm_node slope[2]) {
    const pm_node one = pm_constant(g, 1, 1, 1);
    const pm_node a_from = from[s->a], a_to = to[s->a], b_from = from[s->b], b_to = to[s->b];
    slope[0] = one;
    slope[1] = PM_NO_NODE;
    switch (s->kind) {
    case ADD:
        slope[1] = one;
        break;
    case SUBTRACT:
        slope[1] = pm_constant(g, -1, 1, 1);
        break;
    case MULTIPLY:
        slope[0] = mean(g, b_from, b_to);
        slope[1] = mean(g, a_from, a_to);
        break;
    case DIVIDE:
        slope[0] = mean(g, pm_div(g, one, b_from), pm_div(g, one, b_to));
        slope[1] = pm_scale(g, pm_div(g, mean(g, a_from, a_to), pm_mul(g, b_from, b_to)), -1);
        break;
    case EXP:
        slope[0] = pm_div(g, one, pm_inverse_logarithmic_mean(g, own_from, own_to));
        break;
    case LN:
        slope[0] = pm_inverse_logarithmic_mean(g, a_from, a_to);
        break;
    case SQRT:
        slope[0] = pm_div(g, one, pm_add(g, own_from, own_to));
        break;
    case NEGATIVE_SQUARED:
        slope[0] = pm_negative_squared_slope(g, a_from, a_to);
        break;
    case NUMBER:
    case FEATURE:
        break;
    }
}

// weight + what the operand of `width` components has of `more`.
static pm_node add_weight(pm_graph *g, pm_node weight, pm_node more, int width) {
    const pm_shape shape = {pm_graph_shape(g, more).batched, 1, width};
    return pm_add_or(g, weight, width == 1 ? pm_sum_to(g, more, shape) : more);
}

void pm_formula_discrete(pm_graph *g, const pm_formula *formula, const pm_symbols *from,
                         const pm_symbols *to, pm_node *covector) {
    reader r;
    pm_node before[MAX_STEPS], after[MAX_STEPS], weight[MAX_STEPS];
    read_again(&r, formula, from);
    build_steps(g, &r, from, before);
    build_steps(g, &r, to, after);
    for (int i = 0; i < r.count; ++i) {
        weight[i] = i == r.whole ? pm_constant(g, 1, 1, 1) : PM_NO_NODE;
    }
    for (int i = r.whole; i >= 0; --i) {
        const step *s = &r.steps[i];
        if (weight[i] == PM_NO_NODE || s->kind == NUMBER) {
            continue;
        }
        if (s->kind == FEATURE) {
            const char *feature = s->feature;
            const pm_node placed =
                s->component == WHOLE ? weight[i] : pm_place(g, weight[i], s->component, s->size);
            pm_features_discrete(g, 1, &feature, from, to, placed, covector);
            continue;
        }
        pm_node slope[2];
        divided_difference(g, s, before[i], after[i], before, after, slope);
        for (int k = 0; k < 2 && slope[k] != PM_NO_NODE; ++k) {
            const int operand = k == 0 ? s->a : s->b;
            weight[operand] = add_weight(g, weight[operand], pm_mul(g, weight[i], slope[k]),
                                         r.steps[operand].width);
        }
    }
}
