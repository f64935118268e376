// Parses units with tables of symbols and prefixes.
#include "base/unit.h"

#include <ctype.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

typedef struct symbol {
    const char *name;
    int power[PM_UNIT_BASES];
    double factor;
} symbol;

typedef struct prefix {
    const char *name;
    double factor;
} prefix;

static const symbol symbols[] = {
    {"kg", {1}, 1},
    {"m", {0, 1}, 1},
    {"s", {0, 0, 1}, 1},
    {"A", {0, 0, 0, 1}, 1},
    {"K", {0, 0, 0, 0, 1}, 1},
    {"mol", {0, 0, 0, 0, 0, 1}, 1},
    {"rad", {0}, 1},
    {"Hz", {0, 0, -1}, 1},
    {"N", {1, 1, -2}, 1},
    {"Pa", {1, -1, -2}, 1},
    {"J", {1, 2, -2}, 1},
    {"W", {1, 2, -3}, 1},
    {"C", {0, 0, 1, 1}, 1},
    {"V", {1, 2, -3, -1}, 1},
    {"Wb", {1, 2, -2, -1}, 1},
    {"H", {1, 2, -2, -2}, 1},
    {"F", {-1, -2, 4, 2}, 1},
    {"Ohm", {1, 2, -3, -2}, 1},
    {"ohm", {1, 2, -3, -2}, 1},
    {"S", {-1, -2, 3, 2}, 1},
    {"T", {1, 0, -2, -1}, 1},
    {"g", {1}, 1e-3},
    {"l", {0, 3}, 1e-3},
    {"L", {0, 3}, 1e-3},
    {"min", {0, 0, 1}, 60},
    {"h", {0, 0, 1}, 3600},
    {"bar", {1, -1, -2}, 1e5},
    {"deg", {0}, 0.017453292519943295},
};

// The two signs for micro are U+00B5 and U+03BC in UTF-8.
static const prefix prefixes[] = {
    {"f", 1e-15}, {"p", 1e-12}, {"n", 1e-9}, {"u", 1e-6}, {"\xc2\xb5", 1e-6}, {"\xce\xbc", 1e-6},
    {"m", 1e-3},  {"c", 1e-2},  {"d", 0.1},  {"da", 10},  {"h", 100},         {"k", 1e3},
    {"M", 1e6},   {"G", 1e9},   {"T", 1e12}, {"P", 1e15},
};

static const symbol *find_symbol(const char *name, size_t length) {
    for (size_t i = 0; i < sizeof symbols / sizeof *symbols; ++i) {
        if (strlen(symbols[i].name) == length && strncmp(symbols[i].name, name, length) == 0) {
            return &symbols[i];
        }
    }
    return NULL;
}

// Finds the symbol `name` with `length` letters, or a prefix that is followed by one, and writes
// the factor of the prefix. A text that is a symbol itself, such as "min", has no prefix.
static const symbol *find_prefixed(const char *name, size_t length, double *factor) {
    const symbol *found = find_symbol(name, length);
    *factor = 1;
    for (size_t i = 0; i < sizeof prefixes / sizeof *prefixes && found == NULL; ++i) {
        const size_t begin = strlen(prefixes[i].name);
        if (begin < length && strncmp(prefixes[i].name, name, begin) == 0) {
            found = find_symbol(name + begin, length - begin);
            *factor = prefixes[i].factor;
        }
    }
    return found;
}

// Multiplies the unit by a power of the symbol `name` with `length` letters.
static bool multiply(pm_unit *unit, const char *name, size_t length, int power) {
    double factor;
    const symbol *s = find_prefixed(name, length, &factor);
    if (s == NULL) {
        return false;
    }
    for (int k = 0; k < PM_UNIT_BASES; ++k) {
        unit->power[k] += power * s->power[k];
    }
    unit->factor *= pow(factor * s->factor, power);
    return true;
}

static bool is_letter(char c) {
    return isalpha((unsigned char)c) || (unsigned char)c >= 0x80; // or a part of a sign for micro
}

// Reads a symbol with its power; `sign` is -1 after a '/'.
static bool take_symbol(pm_unit *unit, const char **text, int sign) {
    const char *name = *text, *end = name;
    while (is_letter(*end)) {
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
    pm_unit unit = {.known = true, .factor = 1};
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
            unit.known = is_letter(*text) && take_symbol(&unit, &text, sign);
            sign = inside ? within : 1;
        }
    }
    return unit;
}

bool pm_unit_equal(const pm_unit *a, const pm_unit *b) {
    return a->known && b->known && memcmp(a->power, b->power, sizeof a->power) == 0;
}

pm_unit pm_unit_product(const pm_unit *a, const pm_unit *b) {
    pm_unit product = {.known = a->known && b->known, .factor = a->factor * b->factor};
    for (int k = 0; k < PM_UNIT_BASES; ++k) {
        product.power[k] = a->power[k] + b->power[k];
    }
    return product;
}
