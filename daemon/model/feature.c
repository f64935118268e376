// Parses feature expressions, and builds their values and discrete derivatives.
#include "model/feature.h"

#include <assert.h>
#include <ctype.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "base/unit.h"

// Keeps ln|x| and x/|x| finite at x = 0. In the unit of x^2 it is far below any length that occurs.
#define SMALLEST_SQUARE 1e-24
// Keeps a divided difference finite where both lengths are 0.
#define SMALLEST_LENGTH 1e-100
// With these numbers the error of the logarithmic mean is below 1e-16 for arguments within a factor
// of 2 of each other, and below 1e-10 within a factor of 20.
#define MEAN_STEPS 4
#define MEAN_TERMS 6
#define HALVINGS 8 // of an angle, so that the series begins at less than 0.01 for |h| < 2.5

static pm_node norm_squared(pm_graph *g, pm_node x) {
    return pm_dot(g, x, x);
}

static pm_node build_raw(pm_graph *g, pm_node x, pm_node y) {
    (void)g, (void)y;
    return x;
}

static pm_node build_log_norm(pm_graph *g, pm_node x, pm_node y) {
    (void)y;
    return pm_scale(g, pm_log(g, pm_offset(g, norm_squared(g, x), SMALLEST_SQUARE)), 0.5);
}

static pm_node build_log(pm_graph *g, pm_node x, pm_node y) {
    (void)y;
    return pm_scale(g, pm_log(g, pm_offset(g, pm_square(g, x), SMALLEST_SQUARE)), 0.5);
}

static pm_node build_norm_squared(pm_graph *g, pm_node x, pm_node y) {
    (void)y;
    return norm_squared(g, x);
}

static pm_node build_norm(pm_graph *g, pm_node x, pm_node y) {
    (void)y;
    return pm_sqrt(g, pm_offset(g, norm_squared(g, x), SMALLEST_SQUARE));
}

static pm_node build_product(pm_graph *g, pm_node x, pm_node y) {
    return pm_dot(g, x, y);
}

static pm_node negative_part(pm_graph *g, pm_node x) {
    return pm_mul(g, x, pm_is_negative(g, x));
}

static pm_node build_negative_norm(pm_graph *g, pm_node x, pm_node y) {
    return build_norm(g, negative_part(g, x), y);
}

static pm_node build_negative_squared(pm_graph *g, pm_node x, pm_node y) {
    (void)y;
    return norm_squared(g, negative_part(g, x));
}

static pm_node build_direction(pm_graph *g, pm_node x, pm_node y) {
    return pm_div(g, x, build_norm(g, x, y));
}

static pm_node build_inverse(pm_graph *g, pm_node x, pm_node y) {
    (void)y;
    return pm_div(g, x, pm_offset(g, norm_squared(g, x), SMALLEST_SQUARE));
}

static pm_node build_distance(pm_graph *g, pm_node x, pm_node y) {
    return build_norm(g, pm_sub(g, x, y), y);
}

static pm_node build_log_distance(pm_graph *g, pm_node x, pm_node y) {
    return build_log_norm(g, pm_sub(g, x, y), y);
}

// --- discrete derivatives: add the weight of a feature to the co-vectors of x and y ---

// A vector at both ends of a step.
typedef struct pair {
    pm_node from, to;
} pair;

static pm_node sum_of(pm_graph *g, pair x) {
    return pm_add(g, x.from, x.to);
}

static void discrete_raw(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx, pm_node *dy) {
    (void)x, (void)y, (void)dy;
    *dx = pm_add_or(g, *dx, weight);
}

static void discrete_norm_squared(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx,
                                  pm_node *dy) {
    (void)y, (void)dy;
    *dx = pm_add_or(g, *dx, pm_mul(g, weight, sum_of(g, x)));
}

static void discrete_norm(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx, pm_node *dy) {
    (void)dy;
    const pm_node lengths = pm_add(g, build_norm(g, x.from, y.from), build_norm(g, x.to, y.to));
    *dx = pm_add_or(g, *dx, pm_mul(g, weight, pm_div(g, sum_of(g, x), lengths)));
}

// Borchardt's arithmetic-geometric steps keep the mean and draw a and b together; then a series in
// the remaining difference w gives the mean (Carlson, Math. Comp. 26 (1972) 543).
pm_node pm_inverse_logarithmic_mean(pm_graph *g, pm_node a, pm_node b) {
    pm_node arithmetic = pm_scale(g, pm_add(g, a, b), 0.5);
    pm_node geometric = pm_sqrt(g, pm_mul(g, a, b));
    for (int i = 0; i < MEAN_STEPS; ++i) {
        arithmetic = pm_scale(g, pm_add(g, arithmetic, geometric), 0.5);
        geometric = pm_sqrt(g, pm_mul(g, arithmetic, geometric));
    }
    // 1/mean = artanh(w) / (w arithmetic) with w^2 = 1 - (geometric/arithmetic)^2.
    const pm_node ratio = pm_div(g, geometric, arithmetic);
    const pm_node square = pm_offset(g, pm_scale(g, pm_mul(g, ratio, ratio), -1), 1);
    pm_node series = pm_constant(g, 1.0 / (2 * MEAN_TERMS + 1), 1, 1);
    for (int i = MEAN_TERMS - 1; i >= 0; --i) {
        series = pm_offset(g, pm_mul(g, series, square), 1.0 / (2 * i + 1));
    }
    return pm_div(g, series, arithmetic);
}

// ln|x| = ln(|x|^2)/2 changes by (x_from + x_to) . (x_to - x_from) / (2 mean of |x|^2).
static void discrete_log_norm(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx,
                              pm_node *dy) {
    (void)y, (void)dy;
    const pm_node from = pm_offset(g, norm_squared(g, x.from), SMALLEST_SQUARE);
    const pm_node to = pm_offset(g, norm_squared(g, x.to), SMALLEST_SQUARE);
    const pm_node slope = pm_scale(g, pm_inverse_logarithmic_mean(g, from, to), 0.5);
    *dx = pm_add_or(g, *dx, pm_mul(g, pm_mul(g, weight, slope), sum_of(g, x)));
}

static void discrete_product(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx,
                             pm_node *dy) {
    const pm_node half = pm_scale(g, weight, 0.5);
    *dx = pm_add_or(g, *dx, pm_mul(g, half, sum_of(g, y)));
    *dy = pm_add_or(g, *dy, pm_mul(g, half, sum_of(g, x)));
}

// With m = min(x,0), component by component: (m_to^2 - m_from^2) / (x_to - x_from) is
// -(m_from + m_to)^2 / (|x_from| + |x_to|), which loses no digit where the two are close.
pm_node pm_negative_squared_slope(pm_graph *g, pm_node from, pm_node to) {
    const pm_node sum = pm_add(g, negative_part(g, from), negative_part(g, to));
    // |x| = x - 2 min(x,0)
    const pm_node lengths = pm_sub(g, pm_add(g, from, to), pm_scale(g, sum, 2));
    return pm_scale(g, pm_div(g, pm_square(g, sum), pm_offset(g, lengths, SMALLEST_LENGTH)), -1);
}

static void discrete_negative_squared(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx,
                                      pm_node *dy) {
    (void)y, (void)dy;
    *dx = pm_add_or(g, *dx, pm_mul(g, weight, pm_negative_squared_slope(g, x.from, x.to)));
}

static void discrete_negative_norm(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx,
                                   pm_node *dy) {
    (void)dy;
    const pm_node lengths =
        pm_add(g, build_negative_norm(g, x.from, y.from), build_negative_norm(g, x.to, y.to));
    *dx = pm_add_or(
        g, *dx, pm_mul(g, weight, pm_div(g, pm_negative_squared_slope(g, x.from, x.to), lengths)));
}

// The divided difference is the derivative in the middle times sin(h)/h with h = (b - a)/2. Viete's
// product of cos(h/2^k) gives the latter also at h = 0; what is left of it after HALVINGS factors
// is a short series.
pm_node pm_trigonometric_difference(pm_graph *g, bool sine, pm_node a, pm_node b) {
    pm_node h = pm_scale(g, pm_sub(g, b, a), 0.5);
    const pm_node middle = pm_scale(g, pm_add(g, a, b), 0.5);
    pm_node slope = sine ? pm_cos(g, middle) : pm_scale(g, pm_sin(g, middle), -1);
    for (int k = 0; k < HALVINGS; ++k) {
        h = pm_scale(g, h, 0.5);
        slope = pm_mul(g, slope, pm_cos(g, h));
    }
    const pm_node square = pm_square(g, h);
    const pm_node series =
        pm_offset(g, pm_mul(g, square, pm_offset(g, pm_scale(g, square, 1.0 / 120), -1.0 / 6)), 1);
    return pm_mul(g, slope, series);
}

#define TRIGONOMETRIC(FUNCTION, SINE)                                                         \
    static pm_node build_##FUNCTION(pm_graph *g, pm_node x, pm_node y) {                      \
        (void)y;                                                                              \
        return pm_##FUNCTION(g, x);                                                           \
    }                                                                                         \
    static void discrete_##FUNCTION(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx, \
                                    pm_node *dy) {                                            \
        (void)y, (void)dy;                                                                    \
        const pm_node slope = pm_trigonometric_difference(g, SINE, x.from, x.to);             \
        *dx = pm_add_or(g, *dx, pm_mul(g, weight, slope));                                    \
    }
TRIGONOMETRIC(sin, true)
TRIGONOMETRIC(cos, false)

// A function of x - y moves x and, with the opposite sign, y.
static void discrete_difference(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx,
                                pm_node *dy,
                                void (*of)(pm_graph *, pm_node, pair, pair, pm_node *, pm_node *)) {
    const pair difference = {pm_sub(g, x.from, y.from), pm_sub(g, x.to, y.to)};
    pm_node slope = PM_NO_NODE;
    of(g, weight, difference, y, &slope, dy);
    *dx = pm_add_or(g, *dx, slope);
    *dy = pm_add_or(g, *dy, pm_scale(g, slope, -1));
}

static void discrete_distance(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx,
                              pm_node *dy) {
    discrete_difference(g, weight, x, y, dx, dy, discrete_norm);
}

static void discrete_log_distance(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx,
                                  pm_node *dy) {
    discrete_difference(g, weight, x, y, dx, dy, discrete_log_norm);
}

// The text around and between the names. In the table a longer form stands before its prefixes.
typedef struct feature_form {
    const char *before, *between, *after; // between: NULL for one name
    bool scalar, angle; // one number; a function of an angle, which is converted to rad
    pm_node (*build)(pm_graph *g, pm_node x, pm_node y);
    // NULL: the form has no discrete derivative.
    void (*discrete)(pm_graph *g, pm_node weight, pair x, pair y, pm_node *dx, pm_node *dy);
} feature_form;

static const feature_form forms[] = {
    {"ln|", "-", "|", true, false, build_log_distance, discrete_log_distance},
    {"|", "-", "|", true, false, build_distance, discrete_distance},
    {"ln|", NULL, "|", true, false, build_log_norm, discrete_log_norm},
    {"|min(", NULL, ",0)|^2", true, false, build_negative_squared, discrete_negative_squared},
    {"|min(", NULL, ",0)|", true, false, build_negative_norm, discrete_negative_norm},
    {"|", NULL, "|^2", true, false, build_norm_squared, discrete_norm_squared},
    {"|", NULL, "|", true, false, build_norm, discrete_norm},
    {"<", ",", ">", true, false, build_product, discrete_product},
    {"sin(", NULL, ")", false, true, build_sin, discrete_sin},
    {"cos(", NULL, ")", false, true, build_cos, discrete_cos},
    {"ln(", NULL, ")", false, false, build_log, NULL},
    {"", "/|", "|^2", false, false, build_inverse, NULL},
    {"", "/|", "|", false, false, build_direction, NULL},
    {"", NULL, "", false, false, build_raw, discrete_raw},
};

static bool skip(const char **text, const char *word) {
    const size_t length = strlen(word);
    if (strncmp(*text, word, length) != 0) {
        return false;
    }
    *text += length;
    return true;
}

static bool take_name(const char **text, char name[PM_MAX_NAME]) {
    static const char letters[] =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.";
    const size_t length = strspn(*text, letters);
    if (length == 0 || length >= PM_MAX_NAME) {
        return false;
    }
    memcpy(name, *text, length);
    name[length] = 0;
    *text += length;
    return true;
}

static bool matches(const feature_form *form, const char *text, char x[PM_MAX_NAME],
                    char y[PM_MAX_NAME]) {
    y[0] = 0;
    return skip(&text, form->before) && take_name(&text, x) &&
           (form->between == NULL || (skip(&text, form->between) && take_name(&text, y))) &&
           skip(&text, form->after) && *text == 0;
}

static const pm_symbol *find_symbol(const pm_symbols *symbols, const char *name) {
    for (int i = 0; i < symbols->count; ++i) {
        if (strcmp(symbols->symbol[i].name, name) == 0) {
            return &symbols->symbol[i];
        }
    }
    return NULL;
}

// Finds the form and its vectors. A quotient must name the same vector twice.
static pm_status parse(const char *expression, const pm_symbols *symbols,
                       const feature_form **found, const pm_symbol **x, const pm_symbol **y) {
    char first[PM_MAX_NAME], second[PM_MAX_NAME];
    for (size_t i = 0; i < sizeof forms / sizeof *forms; ++i) {
        if (!matches(&forms[i], expression, first, second)) {
            continue;
        }
        *found = &forms[i];
        *x = find_symbol(symbols, first);
        *y = second[0] == 0 ? *x : find_symbol(symbols, second);
        if (*x == NULL || *y == NULL) {
            char list[512] = "";
            size_t used = 0;
            for (int k = 0; k < symbols->count && used < sizeof list; ++k) {
                used += (size_t)snprintf(list + used, sizeof list - used, "%s%s", k > 0 ? ", " : "",
                                         symbols->symbol[k].name);
            }
            return pm_fail(PM_ECONFIG,
                           "formula or feature \"%s\": there is no \"%s\" here, only %s",
                           expression, *x == NULL ? first : second, list);
        }
        if ((*x)->size != (*y)->size || (!forms[i].scalar && *x != *y)) {
            return pm_fail(PM_ECONFIG,
                           "formula or feature \"%s\": \"%s\" and \"%s\" do not fit together",
                           expression, first, second);
        }
        return PM_OK;
    }
    return pm_fail(PM_ECONFIG,
                   "formula or feature \"%s\": expected x, |x|, ln|x|, |x|^2, |x-y|, ln|x-y|, "
                   "<x,y>, sin(x), cos(x), "
                   "ln(x), |min(x,0)|, |min(x,0)|^2, x/|x| or x/|x|^2",
                   expression);
}

void pm_symbols_add(pm_symbols *symbols, pm_graph *g, const pm_layout *layout, const char *prefix,
                    pm_node vector) {
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        char name[PM_MAX_NAME];
        snprintf(name, sizeof name, "%s%s", prefix, group->name);
        pm_symbols_add_one(symbols, name, group->size,
                           g == NULL              ? PM_NO_NODE
                           : vector == PM_NO_NODE ? pm_constant(g, 0, 1, group->size)
                                                  : pm_slice(g, vector, group->first, group->size));
        const pm_unit unit = pm_unit_parse(group->unit);
        symbols->symbol[symbols->count - 1].radians = unit.angle ? unit.factor : 1;
    }
}

void pm_symbols_add_one(pm_symbols *symbols, const char *name, int size, pm_node node) {
    assert(symbols->count < PM_MAX_SYMBOLS);
    pm_symbol *symbol = &symbols->symbol[symbols->count++];
    snprintf(symbol->name, sizeof symbol->name, "%s", name);
    symbol->size = size;
    symbol->node = node;
    symbol->radians = 1;
}

// Returns the vector of a symbol as a form takes it.
static pm_node as_taken(pm_graph *g, const feature_form *form, const pm_symbol *x) {
    const bool converted = form->angle && (x->radians < 1 || x->radians > 1);
    return converted ? pm_scale(g, x->node, x->radians) : x->node;
}

static bool is_letter(char c) {
    return isalnum((unsigned char)c) || c == '_';
}

bool pm_feature_mentions(const char *expression, const char *name) {
    const size_t length = strlen(name);
    for (const char *at = expression; (at = strstr(at, name)) != NULL; ++at) {
        if ((at == expression || !is_letter(at[-1])) && !is_letter(at[length])) {
            return true;
        }
    }
    return false;
}

pm_status pm_feature_size(const char *expression, const pm_symbols *symbols, int *size) {
    const feature_form *form = NULL;
    const pm_symbol *x = NULL, *y = NULL;
    PM_TRY(parse(expression, symbols, &form, &x, &y));
    *size = form->scalar ? 1 : x->size;
    return PM_OK;
}

pm_node pm_feature_build(pm_graph *g, const char *expression, const pm_symbols *symbols) {
    const feature_form *form = NULL;
    const pm_symbol *x = NULL, *y = NULL;
    const pm_status status = parse(expression, symbols, &form, &x, &y);
    assert(status == PM_OK);
    (void)status;
    return form->build(g, as_taken(g, form, x), as_taken(g, form, y));
}

bool pm_features_are_discrete(int count, const char *const *expression) {
    char x[PM_MAX_NAME], y[PM_MAX_NAME];
    for (int i = 0; i < count; ++i) {
        size_t k = 0;
        while (!matches(&forms[k], expression[i], x, y)) {
            ++k; // the last form matches any name, and the expression was checked
        }
        if (forms[k].discrete == NULL) {
            return false;
        }
    }
    return true;
}

void pm_features_discrete(pm_graph *g, int count, const char *const *expression,
                          const pm_symbols *from, const pm_symbols *to, pm_node weight,
                          pm_node *covector) {
    int first = 0;
    for (int i = 0; i < count; ++i) {
        const feature_form *form = NULL;
        const pm_symbol *x = NULL, *y = NULL;
        const pm_status status = parse(expression[i], from, &form, &x, &y);
        assert(status == PM_OK && form->discrete != NULL);
        (void)status;
        const ptrdiff_t ix = x - from->symbol, iy = y - from->symbol;
        const int size = form->scalar ? 1 : x->size;
        const pm_node own = pm_slice(g, weight, first, size);
        form->discrete(
            g,
            form->angle && (x->radians < 1 || x->radians > 1) ? pm_scale(g, own, x->radians) : own,
            (pair){as_taken(g, form, x), as_taken(g, form, &to->symbol[ix])},
            (pair){as_taken(g, form, y), as_taken(g, form, &to->symbol[iy])}, &covector[ix],
            &covector[iy]);
        first += size;
    }
}

pm_status pm_features_size(int count, const char *const *expression, const pm_symbols *symbols,
                           int *size) {
    int total = 0;
    if (count > PM_MAX_FEATURES) {
        return pm_fail(PM_ECONFIG, "%d expressions, at most %d are possible", count,
                       PM_MAX_FEATURES);
    }
    for (int i = 0; i < count; ++i) {
        int one = 0;
        PM_TRY(pm_feature_size(expression[i], symbols, &one));
        total += one;
    }
    *size = total;
    return PM_OK;
}

pm_node pm_features_build(pm_graph *g, int count, const char *const *expression,
                          const pm_symbols *symbols) {
    pm_node part[PM_MAX_FEATURES];
    assert(count > 0 && count <= PM_MAX_FEATURES);
    for (int i = 0; i < count; ++i) {
        part[i] = pm_feature_build(g, expression[i], symbols);
    }
    return pm_concat(g, count, part);
}
