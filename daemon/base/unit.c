// Parses units with a table of symbols.
#include "base/unit.h"

#include <ctype.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

typedef struct symbol {
    const char *name;
    int power[PM_UNIT_BASES];
} symbol;

static const symbol symbols[] = {
    {"kg", {1}},
    {"m", {0, 1}},
    {"s", {0, 0, 1}},
    {"A", {0, 0, 0, 1}},
    {"K", {0, 0, 0, 0, 1}},
    {"mol", {0, 0, 0, 0, 0, 1}},
    {"rad", {0}},
    {"Hz", {0, 0, -1}},
    {"N", {1, 1, -2}},
    {"Pa", {1, -1, -2}},
    {"J", {1, 2, -2}},
    {"W", {1, 2, -3}},
    {"C", {0, 0, 1, 1}},
    {"V", {1, 2, -3, -1}},
    {"Wb", {1, 2, -2, -1}},
    {"H", {1, 2, -2, -2}},
    {"F", {-1, -2, 4, 2}},
    {"Ohm", {1, 2, -3, -2}},
    {"ohm", {1, 2, -3, -2}},
    {"S", {-1, -2, 3, 2}},
    {"T", {1, 0, -2, -1}},
};

// Multiplies the unit by a power of the symbol `name` with `length` letters.
static bool multiply(pm_unit *unit, const char *name, size_t length, int power) {
    for (size_t i = 0; i < sizeof symbols / sizeof *symbols; ++i) {
        if (strlen(symbols[i].name) == length && strncmp(symbols[i].name, name, length) == 0) {
            for (int k = 0; k < PM_UNIT_BASES; ++k) {
                unit->power[k] += power * symbols[i].power[k];
            }
            return true;
        }
    }
    return false;
}

// Reads a symbol with its power; `sign` is -1 after a '/'.
static bool take_symbol(pm_unit *unit, const char **text, int sign) {
    const char *name = *text, *end = name;
    while (isalpha((unsigned char)*end)) {
        ++end;
    }
    const char *number = *end == '^' ? end + 1 : end;
    char *after = NULL;
    long power = strtol(number, &after, 10);
    const bool given = after != number;
    if ((*end == '^' && !given) || power < -9 || power > 9) {
        return false;
    }
    *text = given ? after : end;
    return multiply(unit, name, (size_t)(end - name), sign * (given ? (int)power : 1));
}

pm_unit pm_unit_parse(const char *text) {
    pm_unit unit = {.known = true};
    int sign = 1, within = 1; // for the next symbol; for symbols in parentheses
    bool inside = false;
    while (unit.known && *text != '\0') {
        if (*text == '/') {
            sign = -1;
            ++text;
        } else if (*text == '(') {
            inside = true;
            within = sign;
            ++text;
        } else if (*text == ')') {
            inside = false;
            sign = 1;
            ++text;
        } else if (*text == ' ' || *text == '*' || *text == '.') {
            ++text;
        } else if (*text == '1' && !isdigit((unsigned char)text[1])) {
            ++text; // a number, as in "1/s"
        } else {
            unit.known = isalpha((unsigned char)*text) && take_symbol(&unit, &text, sign);
            sign = inside ? within : 1;
        }
    }
    return unit;
}

bool pm_unit_equal(const pm_unit *a, const pm_unit *b) {
    return a->known && b->known && memcmp(a->power, b->power, sizeof a->power) == 0;
}

pm_unit pm_unit_product(const pm_unit *a, const pm_unit *b) {
    pm_unit product = {.known = a->known && b->known};
    for (int k = 0; k < PM_UNIT_BASES; ++k) {
        product.power[k] = a->power[k] + b->power[k];
    }
    return product;
}
