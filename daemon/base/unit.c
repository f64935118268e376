// Parses units with tables of symbols and prefixes.
#include "base/unit.h"

#include <ctype.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
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
    {"\xc2\xb0", {0}, 0.017453292519943295}, // the sign for degrees
    {"eV", {1, 2, -2}, 1.602176634e-19},
    {"cal", {1, 2, -2}, 4.184},
    {"\xce\xa9", {1, 2, -3, -2}, 1},     // a capital omega
    {"\xe2\x84\xa6", {1, 2, -3, -2}, 1}, // the sign for ohm
    {"rpm", {0, 0, -1}, 0.10471975511965977},
    {"rev", {0}, 6.283185307179586},
    {"psi", {1, -1, -2}, 6894.757293168361},
    {"atm", {1, -1, -2}, 101325},
    {"mmHg", {1, -1, -2}, 133.322387415},
    {"inch", {0, 1}, 0.0254},
    {"ft", {0, 1}, 0.3048},
    {"lb", {1}, 0.45359237},
    {"lbf", {1, 1, -2}, 4.4482216152605},
    {"day", {0, 0, 1}, 86400},
    {"mph", {0, 1, -1}, 0.44704},
    {"ppm", {0}, 1e-6},
};

// Units that are written alone: temperatures with an offset, in K, and numbers.
typedef struct lone_unit {
    const char *name;
    int kelvin; // power
    double factor, offset;
} lone_unit;

#define CELSIUS 1, 1, 273.15
#define FAHRENHEIT 1, 5.0 / 9, 459.67 * 5 / 9

static const lone_unit lone_units[] = {
    {"degC", CELSIUS},       {"\u00b0C", CELSIUS},  {"\u2103", CELSIUS},   {"deg C", CELSIUS},
    {"Deg C", CELSIUS},      {"celsius", CELSIUS},  {"Celsius", CELSIUS},  {"degF", FAHRENHEIT},
    {"\u00b0F", FAHRENHEIT}, {"deg F", FAHRENHEIT}, {"Deg F", FAHRENHEIT}, {"%", 0, 0.01, 0},
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

// Multiplies the unit by a power of the symbol `name` with `length` letters. A text such as "Nms"
// or "mAh", which is no symbol, is a product of symbols. Only the first of them may have a prefix,
// and the power belongs to the last.
static bool multiply(pm_unit *unit, const char *name, size_t length, int sign, int power) {
    double factor;
    bool first = true;
    while (length > 0) {
        size_t head = length;
        const symbol *s = NULL;
        for (; head > 0; --head) {
            s = first ? find_prefixed(name, head, &factor) : find_symbol(name, head);
            if (s != NULL) {
                break;
            }
        }
        const bool is_degree =
            s != NULL && (strcmp(s->name, "deg") == 0 || strcmp(s->name, "\xc2\xb0") == 0);
        if (s == NULL || (head < length && is_degree)) { // "degC" has an offset
            return false;
        }
        const int times = sign * (head == length ? power : 1);
        for (int k = 0; k < PM_UNIT_BASES; ++k) {
            unit->power[k] += times * s->power[k];
        }
        unit->factor *= pow((first ? factor : 1) * s->factor, times);
        unit->angle = unit->angle || is_degree || strcmp(s->name, "rad") == 0 ||
                      strcmp(s->name, "rpm") == 0 || strcmp(s->name, "rev") == 0;
        unit->cycles = unit->cycles || strcmp(s->name, "Hz") == 0;
        name += head;
        length -= head;
        first = false;
    }
    return true;
}

// --- signs outside ASCII, in UTF-8 ---

// Returns the length of the sign of multiplication at `text`, a blank among them, or 0.
static size_t skip_product(const char *text) {
    static const char *const signs[] = {" ", "*", ".", "\xc2\xb7", "\xe2\x8b\x85"};
    for (size_t i = 0; i < sizeof signs / sizeof *signs; ++i) {
        if (strncmp(text, signs[i], strlen(signs[i])) == 0) {
            return strlen(signs[i]);
        }
    }
    return 0;
}

// Reads a raised digit or a raised minus into *digit. Returns its length, or 0 if there is none.
static size_t read_raised(const char *text, char *digit) {
    static const char *const signs[] = {"\xe2\x81\xb0", "\xc2\xb9",     "\xc2\xb2",
                                        "\xc2\xb3",     "\xe2\x81\xb4", "\xe2\x81\xb5",
                                        "\xe2\x81\xb6", "\xe2\x81\xb7", "\xe2\x81\xb8",
                                        "\xe2\x81\xb9", "\xe2\x81\xbb"};
    for (size_t i = 0; i < sizeof signs / sizeof *signs; ++i) {
        if (strncmp(text, signs[i], strlen(signs[i])) == 0) {
            *digit = "0123456789-"[i];
            return strlen(signs[i]);
        }
    }
    return 0;
}

// Reads a power, such as "^2", "**2", "2" or raised characters, and moves *text behind it. Without
// any the power is 1. Returns false if there is none after a '^', or if it is larger than 9.
static bool take_power(const char **text, int *power) {
    const size_t mark = **text == '^' ? 1 : strncmp(*text, "**", 2) == 0 ? 2 : 0;
    char raised[4] = {0}, *after = NULL;
    const char *number = *text + mark;
    size_t count = 0;
    for (size_t length; count < 3 && (length = read_raised(number, &raised[count])) > 0; ++count) {
        number += length;
    }
    const char *begin = count > 0 ? raised : number;
    const long read = strtol(begin, &after, 10);
    const bool given = after != begin;
    if ((mark > 0 && !given) || read < -9 || read > 9) {
        return false;
    }
    *power = given ? (int)read : 1;
    *text = !given ? *text : count > 0 ? number : after;
    return true;
}

#define MOST_PARENTHESES 8 // one in the other

pm_unit pm_unit_parse(const char *text) {
    pm_unit unit = {.known = true, .factor = 1};
    int sign = 1, depth = 0;                // of the next symbol; open parentheses
    int within[MOST_PARENTHESES + 1] = {1}; // sign of what stands in them
    for (size_t i = 0; i < sizeof lone_units / sizeof *lone_units; ++i) {
        if (strcmp(lone_units[i].name, text) == 0) {
            unit.factor = lone_units[i].factor;
            unit.offset = lone_units[i].offset;
            unit.power[PM_UNIT_K] = lone_units[i].kelvin;
            return unit;
        }
    }
    if (strcmp(text, "-") == 0) { // the usual sign for a number
        return unit;
    }
    while (unit.known && *text != '\0') {
        if (*text == '/') {
            sign = -within[depth];
            ++text;
        } else if (*text == '(') {
            unit.known = depth < MOST_PARENTHESES;
            depth += unit.known;
            within[depth] = sign;
            ++text;
        } else if (*text == ')') {
            depth -= depth > 0;
            sign = within[depth];
            ++text;
        } else if (skip_product(text) > 0) {
            text += skip_product(text);
        } else if (*text == '1' && !isdigit((unsigned char)text[1])) {
            ++text; // a number, as in "1/s"
        } else {
            const char *name = text;
            int power = 1;
            char digit;
            while (isalpha((unsigned char)*text) ||
                   ((unsigned char)*text >= 0x80 && skip_product(text) == 0 &&
                    read_raised(text, &digit) == 0)) {
                ++text; // a letter
            }
            const size_t length = (size_t)(text - name);
            unit.known = length > 0 && take_power(&text, &power) &&
                         multiply(&unit, name, length, sign, power);
            sign = within[depth];
        }
    }
    return unit;
}

bool pm_unit_equal(const pm_unit *a, const pm_unit *b) {
    return a->known && b->known && memcmp(a->power, b->power, sizeof a->power) == 0;
}

static pm_unit combine(const pm_unit *a, const pm_unit *b, int sign) {
    pm_unit result = {.known = a->known && b->known,
                      .factor = sign > 0 ? a->factor * b->factor : a->factor / b->factor};
    for (int k = 0; k < PM_UNIT_BASES; ++k) {
        result.power[k] = a->power[k] + sign * b->power[k];
    }
    return result;
}

pm_unit pm_unit_product(const pm_unit *a, const pm_unit *b) {
    return combine(a, b, 1);
}

pm_unit pm_unit_quotient(const pm_unit *a, const pm_unit *b) {
    return combine(a, b, -1);
}

bool pm_unit_conversion(const char *text, const pm_unit *to, double *factor, double *offset) {
    const pm_unit kelvin = pm_unit_parse("K");
    const bool warm = pm_unit_equal(to, &kelvin);
    const pm_unit from = pm_unit_parse(warm && strcmp(text, "C") == 0   ? "degC"
                                       : warm && strcmp(text, "F") == 0 ? "degF"
                                                                        : text);
    if (!pm_unit_equal(&from, to) || (from.cycles && to->angle) || (from.angle && to->cycles)) {
        return false;
    }
    *factor = from.factor / to->factor;
    *offset = (from.offset - to->offset) / to->factor;
    return true;
}

const char *pm_unit_symbol(const pm_unit *unit) {
    for (size_t i = 0; i < sizeof symbols / sizeof *symbols && unit->known; ++i) {
        if (symbols[i].factor == unit->factor && strcmp(symbols[i].name, "Hz") != 0 &&
            strcmp(symbols[i].name, "rad") != 0 &&
            memcmp(symbols[i].power, unit->power, sizeof unit->power) == 0) {
            return symbols[i].name;
        }
    }
    return NULL;
}

bool pm_unit_name(const pm_unit *unit, char *text) {
    static const char *const base[PM_UNIT_BASES] = {"kg", "m", "s", "A", "K", "mol"};
    const char *short_name = pm_unit_symbol(unit);
    if (short_name != NULL) {
        snprintf(text, PM_UNIT_NAME, "%s", short_name);
        return true;
    }
    if (!unit->known || unit->factor < 1 || unit->factor > 1) {
        return false;
    }
    const pm_unit kelvin = pm_unit_parse("K"), times_kelvin = pm_unit_product(unit, &kelvin);
    const char *over_kelvin = pm_unit_symbol(&times_kelvin);
    if (unit->power[PM_UNIT_K] == -1 && over_kelvin != NULL) {
        snprintf(text, PM_UNIT_NAME, "%s/K", over_kelvin);
        return true;
    }
    int written = 0, below = 0;
    for (int i = 0; i < PM_UNIT_BASES; ++i) {
        below += unit->power[i] < 0;
        if (abs(unit->power[i]) > 99) {
            return false;
        }
    }
    for (int side = 1; side >= -1; side -= 2) {
        const int begun = written;
        for (int i = 0; i < PM_UNIT_BASES; ++i) {
            const int power = side * unit->power[i];
            if (power > 0) {
                const bool first = written == begun;
                written += snprintf(text + written, PM_UNIT_NAME - (size_t)written,
                                    power > 1 ? "%s%s%s^%d" : "%s%s%s",
                                    side > 0 || !first ? ""
                                    : begun == 0       ? "1/"
                                                       : "/",
                                    !first                  ? " "
                                    : side < 0 && below > 1 ? "("
                                                            : "",
                                    base[i], power);
            }
        }
    }
    snprintf(text + written, PM_UNIT_NAME - (size_t)written, "%s",
             written == 0 ? "1"
             : below > 1  ? ")"
                          : "");
    return true;
}
