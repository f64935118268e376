// Reads the scalars of a YAML document, and lists of them.
#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "store/yaml_document.h"

// --- scalars ---

// Returns the text of an unquoted scalar that consists of the given characters, which exclude
// hexadecimal numbers, infinities and NaN; otherwise NULL.
static const char *number_text(pm_yaml value, const char *characters) {
    const char *text = pm_yaml_scalar(value);
    const bool plain =
        text != NULL && pm_yaml_node(value)->data.scalar.style == YAML_PLAIN_SCALAR_STYLE;
    return plain && *text != '\0' && text[strspn(text, characters)] == '\0' ? text : NULL;
}

static pm_status fail_range(pm_yaml value, const char *noun, double low, double high) {
    char what[96];
    const bool positive = low == DBL_MIN;
    if (isinf(low) && isinf(high)) {
        snprintf(what, sizeof what, "%s", noun);
    } else if (isinf(low)) {
        snprintf(what, sizeof what, "%s <= %.10g", noun, high);
    } else if (isinf(high)) {
        snprintf(what, sizeof what, "%s %s %.10g", noun, positive ? ">" : ">=", positive ? 0 : low);
    } else {
        snprintf(what, sizeof what, "%s %s %.10g and <= %.10g", noun,
                 positive ? ">" : ">=", positive ? 0 : low, high);
    }
    return pm_yaml_fail_expected(value, what);
}

pm_status pm_yaml_double(pm_yaml value, double low, double high, double *result) {
    const char *text = number_text(value, "+-0123456789.eE");
    char *end = NULL;
    const double number = text == NULL ? NAN : strtod(text, &end);
    if (text == NULL || *end != '\0' || !isfinite(number) || number < low || number > high) {
        return fail_range(value, "a number", low, high);
    }
    *result = number;
    return PM_OK;
}

pm_status pm_yaml_int(pm_yaml value, int low, int high, int *result) {
    const char *text = number_text(value, "+-0123456789");
    char *end = NULL;
    const long number =
        text == NULL ? 0 : strtol(text, &end, 10); // saturates, and the range then refuses it
    if (text == NULL || *end != '\0' || end == text || number < low || number > high) {
        return fail_range(value, "a whole number", low == INT_MIN ? -INFINITY : (double)low,
                          high == INT_MAX ? INFINITY : (double)high);
    }
    *result = (int)number;
    return PM_OK;
}

pm_status pm_yaml_bool(pm_yaml value, bool *result) {
    static const char *const names[] = {"false", "true", NULL};
    int choice;
    PM_TRY(pm_yaml_choice(value, names, &choice));
    *result = choice == 1;
    return PM_OK;
}

pm_status pm_yaml_text(pm_yaml value, pm_arena *arena, const char **result) {
    const char *text = pm_yaml_scalar(value);
    if (text == NULL || *text == '\0') {
        return pm_yaml_fail_expected(value, "text");
    }
    const char *copy = pm_arena_strdup(arena, text);
    if (copy == NULL) {
        return pm_yaml_fail_memory();
    }
    *result = copy;
    return PM_OK;
}

pm_status pm_yaml_choice(pm_yaml value, const char *const *names, int *result) {
    const int choice = pm_yaml_position(names, value);
    if (choice < 0) {
        char list[512], what[600];
        snprintf(what, sizeof what, "one of %s", pm_yaml_join(names, list, sizeof list));
        return pm_yaml_fail_expected(value, what);
    }
    *result = choice;
    return PM_OK;
}

// --- lists of scalars ---

// Gives the number of entries, and memory for them of `size` bytes each.
static pm_status open_list(pm_yaml list, const char *what, pm_arena *arena, size_t size, int *count,
                           void **memory) {
    const bool is_list = pm_yaml_is_list(list);
    if (!is_list && pm_yaml_scalar(list) == NULL) {
        return pm_yaml_fail_expected(list, what);
    }
    *count = is_list ? pm_yaml_count(list) : 1;
    *memory = pm_arena_array(arena, (size_t)*count, size);
    return *memory == NULL ? pm_yaml_fail_memory() : PM_OK;
}

static pm_yaml list_entry(pm_yaml list, int i) {
    return pm_yaml_is_list(list) ? pm_yaml_item(list, i) : list;
}

pm_status pm_yaml_doubles(pm_yaml list, pm_arena *arena, int *count, double **result) {
    int n;
    void *memory;
    PM_TRY(open_list(list, "a list of numbers", arena, sizeof(double), &n, &memory));
    double *number = memory;
    for (int i = 0; i < n; ++i) {
        PM_TRY(pm_yaml_double(list_entry(list, i), -INFINITY, INFINITY, &number[i]));
    }
    *count = n;
    *result = number;
    return PM_OK;
}

pm_status pm_yaml_ints(pm_yaml list, int low, int high, pm_arena *arena, int *count, int **result) {
    int n;
    void *memory;
    PM_TRY(open_list(list, "a list of whole numbers", arena, sizeof(int), &n, &memory));
    int *number = memory;
    for (int i = 0; i < n; ++i) {
        PM_TRY(pm_yaml_int(list_entry(list, i), low, high, &number[i]));
    }
    *count = n;
    *result = number;
    return PM_OK;
}

pm_status pm_yaml_texts(pm_yaml list, pm_arena *arena, int *count, const char ***result) {
    int n;
    void *memory;
    PM_TRY(open_list(list, "a list of names", arena, sizeof(char *), &n, &memory));
    const char **text = memory;
    for (int i = 0; i < n; ++i) {
        PM_TRY(pm_yaml_text(list_entry(list, i), arena, &text[i]));
    }
    *count = n;
    *result = text;
    return PM_OK;
}
