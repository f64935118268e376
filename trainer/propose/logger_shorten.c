// Reads a formula by recursive descent and writes it again, each operation as short as its operands
// allow.
#include "propose/logger_shorten.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// How tightly the last operation of a text holds it together.
typedef enum binding { OF_SUM, OF_PRODUCT, OF_SIGN, OF_POWER, OF_OPERAND } binding;

// A part of a formula. A number has a value, everything else NAN.
typedef struct part {
    const char *text;
    binding binding;
    double value;
} part;

typedef struct reader {
    pm_arena *arena;
    const char *at;
    int count;
    const char *const *zero;
    bool failed; // the text is no formula
} reader;

static bool take(reader *r, char c) {
    r->at += strspn(r->at, " ");
    const bool is = *r->at == c;
    r->at += is;
    return is;
}

static const char *copy(reader *r, const char *from, size_t length) {
    return pm_arena_printf(r->arena, "%.*s", (int)length, from);
}

static part number(reader *r, double value) {
    const char *text = pm_arena_printf(r->arena, "%.9g", value);
    r->failed = r->failed || !isfinite(value);
    return (part){text, value < 0 ? OF_SIGN : OF_OPERAND, value};
}

// Returns the text of an operand, in brackets unless it binds at least as tightly as asked.
static const char *operand(reader *r, part p, binding least) {
    return p.text != NULL && p.binding < least ? pm_arena_printf(r->arena, "(%s)", p.text) : p.text;
}

static part join(reader *r, part a, const char *sign, part b, binding of) {
    // An operand that begins with a sign stands in brackets behind an operation.
    const char *right = operand(r, b, b.text != NULL && *b.text == '-' ? OF_OPERAND : of + 1);
    return (part){pm_arena_printf(r->arena, "%s%s%s", operand(r, a, of), sign, right), of, NAN};
}

static part negative(reader *r, part a) {
    if (!isnan(a.value)) {
        return a.value == 0 ? a : number(r, -a.value);
    }
    return (part){pm_arena_printf(r->arena, "-%s", operand(r, a, OF_POWER)), OF_SIGN, NAN};
}

// Returns a + b, a - b, a*b or a/b.
static part operate(reader *r, part a, char operation, part b) {
    const bool sum = operation == '+' || operation == '-';
    if (operation == '/' && b.value == 0) {
        r->failed = true;
    } else if (!sum && (a.value == 0 || b.value == 0)) {
        return number(r, 0);
    } else if (!isnan(a.value) && !isnan(b.value)) {
        return number(r, operation == '+'   ? a.value + b.value
                         : operation == '-' ? a.value - b.value
                         : operation == '*' ? a.value * b.value
                                            : a.value / b.value);
    }
    if (b.value == (sum ? 0 : 1)) {
        return a;
    }
    if (a.value == (sum ? 0 : 1) && operation != '/') {
        return operation == '-' ? negative(r, b) : b;
    }
    const char sign[] = {sum ? ' ' : operation, sum ? operation : '\0', ' ', '\0'};
    return join(r, a, sign, b, sum ? OF_SUM : OF_PRODUCT);
}

static part apply(reader *r, const char *function, part x) {
    static const struct {
        const char *name;
        double (*value)(double);
    } functions[] = {{"exp", exp}, {"ln", log}, {"sqrt", sqrt}, {"sin", sin}, {"cos", cos}};
    for (size_t k = 0; k < sizeof functions / sizeof *functions && !isnan(x.value); ++k) {
        if (function != NULL && strcmp(function, functions[k].name) == 0) {
            return number(r, functions[k].value(x.value));
        }
    }
    return (part){pm_arena_printf(r->arena, "%s(%s)", function, x.text), OF_OPERAND, NAN};
}

static part read_sum(reader *r);

static part read_operand(reader *r) {
    r->at += strspn(r->at, " ");
    if (take(r, '(')) {
        const part inner = read_sum(r);
        r->failed = r->failed || !take(r, ')');
        return inner;
    }
    if (*r->at == '|' || *r->at == '<') { // |x|, |min(x, 0)| or <x,y>, which stays as it is
        const bool least = strncmp(r->at, "|min(", strlen("|min(")) == 0;
        const char *end = *r->at == '<' ? strchr(r->at, '>')
                          : least       ? strstr(r->at, ")|")
                                        : strchr(r->at + 1, '|');
        r->failed = r->failed || end == NULL;
        const size_t size = end == NULL ? 1 : (size_t)(end + 1 + least - r->at);
        const part p = {copy(r, r->at, size), OF_OPERAND, NAN};
        r->at += size;
        return p;
    }
    if (isdigit((unsigned char)*r->at)) {
        char *end;
        const double value = strtod(r->at, &end);
        const part p = {copy(r, r->at, (size_t)(end - r->at)), OF_OPERAND, value};
        r->at = end;
        return p;
    }
    size_t length = 0;
    while (pm_logger_is_of_name(r->at[length])) {
        ++length;
    }
    const char *name = copy(r, r->at, length);
    r->failed = r->failed || length == 0 || name == NULL;
    r->at += length;
    if (*r->at == '[') {
        const size_t whole = length + strcspn(r->at, "]") + 1;
        r->failed = r->failed || strchr(r->at, ']') == NULL;
        const part p = {copy(r, r->at - length, whole), OF_OPERAND, NAN};
        r->at += r->failed ? 0 : whole - length;
        return p;
    }
    if (!r->failed && take(r, '(')) {
        const part inner = read_sum(r);
        r->failed = r->failed || !take(r, ')');
        return apply(r, name, inner);
    }
    for (int i = 0; i < r->count && !r->failed; ++i) {
        if (strcmp(r->zero[i], name) == 0) {
            return number(r, 0);
        }
    }
    return (part){name, OF_OPERAND, NAN};
}

static part read_signed(reader *r) {
    if (take(r, '-')) {
        return negative(r, read_signed(r));
    }
    const part base = read_operand(r);
    if (!take(r, '^')) {
        return base;
    }
    const part exponent = read_signed(r);
    return !isnan(base.value) && !isnan(exponent.value) ? number(r, pow(base.value, exponent.value))
           : exponent.value == 1
               ? base
               : (part){pm_arena_printf(r->arena, "%s^%s", operand(r, base, OF_OPERAND),
                                        operand(r, exponent, OF_OPERAND)),
                        OF_POWER, NAN};
}

// Reads operands of + and -, or of * and /, and what joins them.
static part read_chain(reader *r, const char *operations, part (*read)(reader *)) {
    part p = read(r);
    while (!r->failed && !r->arena->failed) {
        r->at += strspn(r->at, " ");
        const char operation = *r->at;
        if (operation == '\0' || strchr(operations, operation) == NULL) {
            break;
        }
        ++r->at;
        p = operate(r, p, operation, read(r));
    }
    return p;
}

static part read_product(reader *r) {
    return read_chain(r, "*/", read_signed);
}

static part read_sum(reader *r) {
    return read_chain(r, "+-", read_product);
}

// Returns the formula without the names, or as it is if it is none.
static const char *shorten(pm_arena *arena, const char *formula, int count,
                           const char *const *zero) {
    reader r = {.arena = arena, .at = formula, .count = count, .zero = zero};
    const part whole = read_sum(&r);
    const bool ended = r.at[strspn(r.at, " ")] == '\0';
    return arena->failed ? NULL : r.failed || !ended ? formula : whole.text;
}

const char *pm_logger_shorten(pm_arena *arena, const char *body, int count,
                              const char *const *zero) {
    static const char item[] = "      - ", nothing[] = "      - \"0\"";
    char *text = NULL, *last = NULL;
    size_t size = 0, length = 0;
    FILE *f = open_memstream(&text, &size);
    bool within = false; // a list of terms, of which one has been written
    for (const char *line = body, *end; f != NULL && *line != '\0'; line = end) {
        FILE *one = open_memstream(&last, &length);
        end = strchr(line, '\n') + 1;
        for (const char *at = line; at < end && one != NULL;) {
            const char *quote = memchr(at, '"', (size_t)(end - at));
            const char *close =
                quote == NULL ? NULL : memchr(quote + 1, '"', (size_t)(end - quote - 1));
            const char *to = close == NULL ? end : quote + 1;
            fwrite(at, 1, (size_t)(to - at), one);
            if (close != NULL) {
                const char *formula =
                    pm_arena_printf(arena, "%.*s", (int)(close - quote - 1), quote + 1);
                const char *brief = formula == NULL ? NULL : shorten(arena, formula, count, zero);
                fprintf(one, "%s\"", brief == NULL ? "" : brief);
                to = close + 1;
            }
            at = to;
        }
        if (one != NULL) {
            fclose(one);
            const bool term = strncmp(last, item, strlen(item)) == 0;
            const bool vanishes = strncmp(last, nothing, strlen(nothing)) == 0;
            const bool more = within || strncmp(end, item, strlen(item)) == 0;
            fputs(vanishes && more ? "" : last, f);
            within = term && (within || !vanishes);
        }
        free(last);
        last = NULL;
    }
    if (f != NULL) {
        fclose(f);
    }
    const char *result = text == NULL ? NULL : pm_arena_strdup(arena, text);
    free(text);
    return result;
}
