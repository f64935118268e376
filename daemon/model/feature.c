// Parsing and building feature expressions.
#include "model/feature.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

// Keeps ln|x| and x/|x| finite at x = 0, far below any length that occurs (in the unit of x^2).
#define SMALLEST_SQUARE 1e-24

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

static pm_node build_direction(pm_graph *g, pm_node x, pm_node y) {
    return pm_div(g, x, build_norm(g, x, y));
}

static pm_node build_inverse(pm_graph *g, pm_node x, pm_node y) {
    (void)y;
    return pm_div(g, x, pm_offset(g, norm_squared(g, x), SMALLEST_SQUARE));
}

// What stands around and between the names; longer forms before their prefixes.
typedef struct feature_form {
    const char *before, *between, *after; // between: NULL for one name
    bool scalar;
    pm_node (*build)(pm_graph *g, pm_node x, pm_node y);
} feature_form;

static const feature_form forms[] = {
    {"ln|", NULL, "|", true, build_log_norm}, {"|", NULL, "|^2", true, build_norm_squared},
    {"|", NULL, "|", true, build_norm},       {"<", ",", ">", true, build_product},
    {"", "/|", "|^2", false, build_inverse},  {"", "/|", "|", false, build_direction},
    {"", NULL, "", false, build_raw},
};

static bool is_name_character(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '.';
}

static bool skip(const char **text, const char *word) {
    const size_t length = strlen(word);
    if (strncmp(*text, word, length) != 0) {
        return false;
    }
    *text += length;
    return true;
}

static bool take_name(const char **text, char name[PM_MAX_NAME]) {
    size_t length = 0;
    while (is_name_character((*text)[length])) {
        ++length;
    }
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

static pm_status unknown_name(const char *expression, const char *name, const pm_symbols *symbols) {
    char list[512] = "";
    size_t used = 0;
    for (int i = 0; i < symbols->count && used < sizeof list; ++i) {
        used += (size_t)snprintf(list + used, sizeof list - used, "%s%s", i > 0 ? ", " : "",
                                 symbols->symbol[i].name);
    }
    return pm_fail(PM_ECONFIG, "feature \"%s\": there is no \"%s\" here, only %s", expression, name,
                   list);
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
            return unknown_name(expression, *x == NULL ? first : second, symbols);
        }
        if ((*x)->size != (*y)->size || (!forms[i].scalar && *x != *y)) {
            return pm_fail(PM_ECONFIG, "feature \"%s\": \"%s\" and \"%s\" do not fit together",
                           expression, first, second);
        }
        return PM_OK;
    }
    return pm_fail(PM_ECONFIG,
                   "feature \"%s\": expected x, |x|, ln|x|, |x|^2, <x,y>, x/|x| or x/|x|^2",
                   expression);
}

void pm_symbols_add(pm_symbols *symbols, pm_graph *g, const pm_layout *layout, const char *prefix,
                    pm_node vector) {
    if (g != NULL && vector == PM_NO_NODE) {
        return;
    }
    for (int i = 0; i < layout->ngroup; ++i) {
        const pm_group *group = &layout->group[i];
        assert(symbols->count < PM_MAX_SYMBOLS);
        pm_symbol *symbol = &symbols->symbol[symbols->count++];
        snprintf(symbol->name, sizeof symbol->name, "%s%s", prefix, group->name);
        symbol->size = group->size;
        symbol->node = g == NULL ? PM_NO_NODE : pm_slice(g, vector, group->first, group->size);
    }
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
    return form->build(g, x->node, y->node);
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
