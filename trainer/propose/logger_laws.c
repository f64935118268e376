// The text of laws and of the constants in them.
#include "propose/logger_laws.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "propose/logger_shorten.h"
#include "propose/search.h"

#define FURTHEST 1e3 // factor by which a positive constant moves from where regressions put it
#define LEAST_CONSTANT 1e-40 // a positive constant begins at no less: capacities of oil are small
#define SMALL 0.1 // with which a part of a law begins that may not be there, relative to the rest
#define DRY 0.02  // of the deviation of a velocity: dry friction is smooth below it
#define POWERS_OF_CHARGE 3    // of the voltage of a cell
#define WARMS 1e-3            // 1/K: with which the resistance of a cell falls with heat
#define KNEES_OF_CHARGE 8     // steps in it, evenly spaced
#define MIDDLE 0.5            // of the distance between two of them
#define WIDTH 25              // a temperature counts as varying by at least 1/25 of it
#define LEAST_POWER 1.5       // of a temperature
#define ROOT 0.5              // power of a level with which its outflow begins
#define EMPTY 1e-3            // of the highest level: below it a vessel is empty
#define CONVECTION_POWER 0.33 // power of a difference of temperatures with which a fit begins
#define STILL 0.01            // K, below which convection no longer depends on it
#define ROOM_TEMPERATURE 293.15
#define DECADE 10
#define MOST_SUMMED 4 // positions over whose sums and products an energy is a sum
#define STEEPEST 4    // power of a squared distance with which friction falls
#define BENDS 3       // bends of a function of one variable, each of which has a place and a width
#define MOST_BENDS 8  // likewise, of a function that may be wavy
// The argument of a logarithm that would round to 0 far below a step of a small width.
#define SHARP 1e-9
// The largest logarithms of the factor of a bend and of the factor of a deviation of a temperature.
// Without a limit noise would make them large outside of the data.
#define MOST_BEND 3
#define DRAINED 0.03   // of the range of a charge: a cell's resistance rises over so much at least
#define MOST_TURNING 3 // of each wave: an inertia or a friction that depends on angles
#define MOST_THERMAL 1
#define MOST_WARMING 6   // power of a temperature
#define MOST_ONE_WAY 2.0 // the logarithm of the ratio of frictions in both directions, halved
#define BRIM 3           // deviations of a level above its mean, below which its brim is
#define LEVER_TEXT (4 * PM_LOGGER_LONG_TEXT)
#define MOST_SINE 0.95 // at which a place within bounds begins

bool pm_logger_begin(pm_logger_writer *w) {
    w->list = open_memstream(&w->constants, &w->size);
    w->model = open_memstream(&w->body, &w->body_size);
    return w->list != NULL && w->model != NULL;
}

// A line of the list of constants: "      NAME: {learned: VALUE...}".
typedef struct listed_constant {
    const char *line, *end, *value, *rest; // `value` and `rest` are NULL where nothing is learned
    char name[PM_LOGGER_TEXT];
    const char *found;    // its value in pm_logger_writer.found; NULL: there is none
    bool zero;            // it is left out, with what it multiplies
    bool shared;          // perhaps the scene names it
    const char *optional; // where its line says so; NULL: it is needed
    double start;         // where it begins, by an earlier fit
    bool anew;            // it begins where its line says, instead
} listed_constant;

// Returns where a text stands between two places; NULL: nowhere.
static const char *find_within(const char *from, const char *to, const char *text) {
    const char *at = strstr(from, text);
    return at != NULL && at < to ? at : NULL;
}

static listed_constant read_constant(const pm_logger_writer *w, const char *model,
                                     const char *line) {
    listed_constant c = {.line = line, .end = strchr(line, '\n') + 1};
    char key[2 * PM_LOGGER_TEXT];
    double value;
    int at = 0, after = 0;
    if (sscanf(line, " %119[^:]: {learned: %n%lf%n", c.name, &at, &value, &after) != 2) {
        return c;
    }
    c.value = line + at;
    c.rest = line + after;
    c.shared = find_within(c.rest, c.end, PM_LOGGER_SHARED) != NULL;
    c.optional = find_within(c.rest, c.end, PM_LOGGER_OPTIONAL);
    snprintf(key, sizeof key, "%s.%s=", model, c.name);
    const char *found = w->found == NULL ? NULL : strstr(w->found, key);
    while (found != NULL && found != w->found && found[-1] != '\n') {
        found = strstr(found + 1, key);
    }
    c.found = found == NULL ? NULL : found + strlen(key);
    if (c.found != NULL && w->lean) {
        const size_t digits = strcspn(c.found, " \n");
        c.zero = strncmp(c.found + digits, PM_SEARCH_SPARE, strlen(PM_SEARCH_SPARE)) == 0;
    }
    return c;
}

// Returns true if constant `c` means nothing where `own` is zero: it vanishes from the formulas
// with it, of which `without` is the rest.
static bool shapes(const listed_constant *c, const listed_constant *own, const char *body,
                   const char *without) {
    return c != own && c->value != NULL && !c->shared && pm_logger_mentions(body, c->name) &&
           !pm_logger_mentions(without, c->name);
}

// Writes the line of a constant behind its value. Where it is optional, it names the constants that
// mean nothing without it.
static void write_rest(pm_logger_writer *w, const char *body, const listed_constant *own,
                       const listed_constant *constant, int count) {
    const char *name = own->name, *without = NULL, *rest = own->rest;
    pm_arena arena = {0};
    bool some = false;
    if (own->optional != NULL) {
        without = pm_logger_shorten(&arena, body, 1, &name);
    }
    for (int i = 0; without != NULL && i < count; ++i) {
        if (shapes(&constant[i], own, body, without)) {
            if (!some) {
                fprintf(w->f, "%.*s, optional: [", (int)(own->optional - rest), rest);
                rest = own->optional + strlen(PM_LOGGER_OPTIONAL);
            }
            fprintf(w->f, "%s%s", some ? ", " : "", constant[i].name);
            some = true;
        }
    }
    fprintf(w->f, "%s%.*s", some ? "]" : "", (int)(own->end - rest), rest);
    pm_arena_free(&arena);
}

// Ends a model: writes its constants, then its body, unless it could not begin.
void pm_logger_end(pm_logger_writer *w, const char *name) {
    const bool begun = w->list != NULL && w->model != NULL;
    pm_arena arena = {0};
    if (w->list != NULL) {
        fclose(w->list);
    }
    if (w->model != NULL) {
        fclose(w->model);
    }
    int count = 0, nzero = 0, written = 0;
    for (const char *line = w->constants; begun && *line != '\0'; line = strchr(line, '\n') + 1) {
        ++count;
    }
    listed_constant *constant = pm_arena_array(&arena, (size_t)count + 1, sizeof *constant);
    const char **zero = pm_arena_array(&arena, (size_t)count + 1, sizeof *zero);
    if (begun && !arena.failed) {
        const char *line = w->constants;
        for (int i = 0; i < count; ++i) {
            constant[i] = read_constant(w, name, line);
            line = constant[i].end;
            zero[nzero] = constant[i].name;
            nzero += constant[i].zero;
        }
        const char *brief = w->lean ? pm_logger_shorten(&arena, w->body, nzero, zero) : w->body;
        const char *body = brief == NULL ? w->body : brief;
        fprintf(w->f, "  %s:\n", name);
        // Constants begin where an earlier fit left them, but positive ones at most a factor
        // FURTHEST away from where regressions put them, because a constant near zero would stay
        // there. Constants that shape a law near zero begin anew with it: they may be anything.
        for (int i = 0; i < count; ++i) {
            listed_constant *c = &constant[i];
            if (c->value == NULL) {
                continue;
            }
            const double start = strtod(c->value, NULL);
            const double own = c->found == NULL ? start : strtod(c->found, NULL);
            const bool positive = strncmp(c->rest, ", positive", strlen(", positive")) == 0;
            const double least = start / FURTHEST, most = start * FURTHEST;
            const char *own_name = c->name, *without = NULL;
            c->start = positive ? fmin(fmax(own, least), most) : own;
            if (positive && own < least && c->optional != NULL) {
                without = pm_logger_shorten(&arena, body, 1, &own_name);
            }
            for (int j = 0; without != NULL && j < count; ++j) {
                constant[j].anew = constant[j].anew || shapes(&constant[j], c, body, without);
            }
        }
        for (int i = 0; i < count; ++i) {
            const listed_constant *c = &constant[i];
            if (c->value != NULL && w->lean && !c->shared && !pm_logger_mentions(body, c->name)) {
                continue;
            }
            fputs(written++ == 0 ? "    constants:\n" : "", w->f);
            if (c->value == NULL) {
                fwrite(c->line, 1, (size_t)(c->end - c->line), w->f);
                continue;
            }
            fprintf(w->f, "%.*s%.6g", (int)(c->value - c->line), c->line,
                    c->anew ? strtod(c->value, NULL) : c->start);
            write_rest(w, body, c, constant, count);
        }
        fputs(body, w->f);
    }
    pm_arena_free(&arena);
    free(w->constants);
    free(w->body);
    w->list = w->model = NULL;
    w->constants = w->body = NULL;
}

// Returns true if the model has a constant "<kind>_<name>".
static bool has_constant(pm_logger_writer *w, const char *kind, const char *name) {
    char line[3 * PM_LOGGER_TEXT];
    snprintf(line, sizeof line, " %s_%s: ", kind, name);
    return fflush(w->list) == 0 && w->constants != NULL && strstr(w->constants, line) != NULL;
}

void pm_logger_constant(pm_logger_writer *w, const char *kind, const char *name, double start,
                        const char *more) {
    if (!has_constant(w, kind, name)) {
        fprintf(w->list, "      %s_%s: {learned: %.6g, positive: true%s}\n", kind, name,
                fmax(fabs(start), LEAST_CONSTANT), more);
    }
}

// Adds a learned constant as pm_logger_number does; `more` are further entries of its line.
static const char *add_number(pm_logger_writer *w, const char *kind, const char *name, double start,
                              double size, const char *more) {
    char *text = w->number[w->nnumber++ % PM_LOGGER_NUMBERS];
    const double scale = size > 0 && isfinite(size) ? pow(DECADE, round(log10(size))) : 1;
    if (!has_constant(w, kind, name)) {
        fprintf(w->list, "      %s_%s: {learned: %.6g%s}\n", kind, name, start / scale, more);
    }
    snprintf(text, PM_LOGGER_TEXT, "%.6g*%.20s_%.90s", scale, kind, name);
    return text;
}

const char *pm_logger_number(pm_logger_writer *w, const char *kind, const char *name, double start,
                             double size) {
    return add_number(w, kind, name, start, size, PM_LOGGER_OPTIONAL);
}

// Adds a learned place between `least` and `largest`, which begins at `start`, unless it exists
// already. Returns the text by which a formula names it, which the next PM_LOGGER_NUMBERS calls
// leave as it is. The place is bounded, because a bend outside of the data is a straight line
// there, and a fit would never bring it back.
static const char *bounded_place(pm_logger_writer *w, const char *kind, const char *name,
                                 double start, double least, double largest) {
    char *text = w->number[w->nnumber++ % PM_LOGGER_NUMBERS];
    const double middle = (least + largest) / 2, half = largest > least ? (largest - least) / 2 : 1;
    if (!has_constant(w, kind, name)) {
        fprintf(w->list, "      %s_%s: {learned: %.6g%s}\n", kind, name,
                asin(fmin(fmax((start - middle) / half, -MOST_SINE), MOST_SINE)),
                start == 0 && middle == 0 ? ", optional: true" : "");
    }
    snprintf(text, 2 * PM_LOGGER_TEXT, "(%.6g + %.6g*sin(%.10s_%.84s))", middle, half, kind, name);
    return text;
}

// Adds the logarithm of a factor, which begins at 0, unless it exists already, and returns its text
// as bounded_place does. It is bounded, because noise would make it large where there are no data.
static const char *logarithm(pm_logger_writer *w, const char *kind, const char *name, double most) {
    return w->v->noisy ? bounded_place(w, kind, name, 0, -most, most)
                       : pm_logger_number(w, kind, name, 0, 1);
}

// Returns the size of the energy of a co-energy.
static double energy_of(const pm_logger_column *y) {
    return y->inertia * y->deviation * y->deviation;
}
// Returns true if the inertia of co-energy c may depend on the positions of its part, which holds
// for their velocities. Velocities that guide positions have constant inertias, because the way in
// which they move the positions depends on angles already.
static bool shares_inertia(const pm_logger_writer *w, int c) {
    const pm_logger_view *v = w->v;
    const pm_logger_column *y = &v->column[c];
    const int chosen = w->chosen[PM_LOGGER_INERTIA];
    bool guided = false, shown = v->inertial[y->part];
    for (int q = 0; q < v->nvariable; ++q) {
        guided = guided || (pm_logger_is(v, q, y->part, PM_LOGGER_POSITION) && v->column[q].guided);
    }
    for (int a = 0; a < v->naction; ++a) { // a force that acts on one of them moves another one
        const pm_logger_column *target = &v->column[v->action[a].target];
        shown = shown || (v->action[a].effect == PM_LOGGER_GAIN && target->mate >= 0 &&
                          v->column[v->action[a].input].guess != PM_LOGGER_FREELY &&
                          target->part == y->part);
    }
    return (chosen == LEARNED_INERTIA || (chosen != CONSTANT_INERTIA && shown)) && y->mate >= 0 &&
           y->kind == PM_LOGGER_FLOW && !guided &&
           pm_logger_count(v, y->part, PM_LOGGER_POSITION) > 1;
}

// Writes features of all positions of a part: sine and cosine of angles, and other positions.
static void write_position_features(const pm_logger_writer *w, int part, const char *prefix) {
    bool some = false;
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *q = &w->v->column[c];
        if (!pm_logger_is(w->v, c, part, PM_LOGGER_POSITION)) {
        } else if (q->angle) {
            fprintf(w->model, "%s\"sin(%s%s)\", \"cos(%s%s)\"", pm_logger_separate(&some), prefix,
                    q->name, prefix, q->name);
        } else {
            fprintf(w->model, "%s%s%s", pm_logger_separate(&some), prefix, q->name);
        }
    }
}

// Writes the co-energy of a temperature: a constant heat capacity and, if it `bends`, powers of the
// temperature, so that the capacity is positive at all temperatures.
static void write_capacity(pm_logger_writer *w, const pm_logger_column *y, bool bends) {
    const char *T = y->name;
    const double T0 = y->mean, width = 2 * y->deviation + T0 / WIDTH;
    const double power[] = {1, LEAST_POWER + T0 / width, -LEAST_POWER - T0 / width};
    static const char *const names[] = {"linear", "rising", "falling"};
    if (y->free_scale) {
        fprintf(
            w->model,
            "      - \"%s*ln(%s/%.6g) - %s\"   # no power is known: the capacity is about 1 J/K\n",
            T, T, T0, T);
    } else {
        pm_logger_constant(w, "capacity", T, y->inertia, "");
        fprintf(w->model, "      - \"capacity_%s*(%s*ln(%s/%.6g) - %s)\"\n", T, T, T, T0, T);
    }
    if (!bends) {
        return;
    }
    for (size_t k = 0; k < sizeof power / sizeof *power; ++k) {
        const double p = power[k];
        pm_logger_constant(w, names[k], T, SMALL * y->inertia, PM_LOGGER_OPTIONAL);
        fprintf(w->model, "      - \"%s_%s*%.6g*(%s/%.6g)^(%.6g)\"\n", names[k], T,
                T0 / (p * (p + 1)), T, T0, p + 1);
    }
    pm_logger_constant(w, "inverse", T, SMALL * y->inertia, PM_LOGGER_OPTIONAL);
    fprintf(w->model, "      - \"inverse_%s*%.6g*ln(%.6g/%s)\"\n", T, T0, T0, T);
}

// Makes "sin1" the name of function k of a series: sin1, cos1, sin2, cos2, ...
static void harmonic(char *sine, int k) {
    const char *const name = k % 2 == 0 ? "sin1" : "cos1";
    memcpy(sine, name, sizeof "sin1");
    sine[strlen("sin")] = (char)('1' + k / 2);
}

// Writes a sum over the positions of a part with learned coefficients of some size, "" or " +
// sin1_name*...": sines and cosines of angles, and first and second powers of lengths if `lengths`
// is true. `prefix` is that of the positions. Only position `alone` counts unless it is -1. A size
// of 0 means that the sum is the logarithm of a factor.
static void write_lever(pm_logger_writer *w, const char *name, const char *prefix, int part,
                        bool lengths, int alone, double size) {
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *q = &w->v->column[c];
        static const char *const powers[] = {"first", "second"};
        const double d = fmax(fabs(q->least), fabs(q->largest));
        char both[PM_LOGGER_TEXT];
        if (!pm_logger_is(w->v, c, part, PM_LOGGER_POSITION) || (!q->angle && !lengths) ||
            (alone >= 0 && alone != c) || q->guess == PM_LOGGER_CYCLIC) {
            continue;
        }
        snprintf(both, sizeof both, "%.40s_by_%.40s", name, q->name);
        for (int k = 0; k < (q->angle ? 2 * q->harmonics : 2); ++k) {
            char sine[] = "sin1";
            harmonic(sine, k);
            const char *kind = q->angle ? sine : powers[k];
            fprintf(w->model, " + %s*",
                    size == 0 && q->angle ? logarithm(w, kind, both, MOST_TURNING)
                                          : pm_logger_number(w, kind, both, 0, size));
            if (q->angle) {
                fprintf(w->model, "%.3s(%d*%s%s)", kind, 1 + k / 2, prefix, q->name);
            } else {
                fprintf(w->model, "(%s%s/%.6g)^%d", prefix, q->name, d, 1 + k);
            }
        }
    }
}

// Writes the co-energy of what an inductance or a capacity adds that depends on the co-energy
// itself. It is positive: parts that grow outside the data, bells, and steps that rise and fall,
// of learned places and widths. Where an inertia depends on positions by a factor c, all of it is a
// function of the co-energy times c, divided by c, as for a core that saturates beside a gap.
static void write_bends(pm_logger_writer *w, const pm_logger_column *y, double inertia,
                        bool turns) {
    // Powers of the co-energy's fourth power, by which it stays below a limit as what softens does.
    static const struct {
        const char *name;
        int power;
    } growth[] = {{"more", 1}, {"steep", 2}, {"wall", 4}};
    const char *name = y->name;
    const double d = fmax(fabs(y->least), fabs(y->largest));
    char lever[LEVER_TEXT] = "", u[2 * LEVER_TEXT], first[2 * LEVER_TEXT];
    if (turns) {
        FILE *const model = w->model;
        w->model = fmemopen(lever, sizeof lever, "w");
        if (w->model != NULL) {
            write_lever(w, name, "", y->part, true, -1, 0);
            fclose(w->model);
        }
        w->model = model;
    }
    snprintf(u, sizeof u, turns ? "(%s*exp(0%s))" : "%s%s", name, lever);
    snprintf(first, sizeof first, turns ? "      - \"exp(-(0%s))*(" : "      - \"%s(", lever);
    for (size_t k = 0; k < sizeof growth / sizeof *growth; ++k) {
        const int n = 4 * growth[k].power;
        pm_logger_constant(w, growth[k].name, name, SMALL * inertia, PM_LOGGER_OPTIONAL);
        fprintf(w->model, "%s%s_%s*%.4g*((%s/%.4g)^4)^%d)\"\n", first, growth[k].name, name,
                d * d / (n * (n - 1)), u, d, growth[k].power);
    }
    const pm_unit pressure = pm_unit_parse("Pa");
    if (pm_unit_equal(&y->dimension, &pressure) && y->least > SMALL * y->largest) {
        // Gas under pressure p has a capacity of p^-2 at constant temperature, and of less high
        // powers without exchange of heat.
        pm_logger_constant(w, "isothermal", name, SMALL * inertia, PM_LOGGER_OPTIONAL);
        pm_logger_constant(w, "polytropic", name, SMALL * inertia, PM_LOGGER_OPTIONAL);
        fprintf(w->model, "%sisothermal_%s*%.6g*ln(%.6g/%s))\"\n", first, name, y->mean * y->mean,
                y->mean, u);
        fprintf(w->model, "%s-polytropic_%s*%.6g*sqrt(%s))\"\n", first, name,
                4 * y->mean * sqrt(y->mean), u);
    }
    for (int k = 0; k < BENDS + 2; ++k) {
        static const char *const kinds[] = {"bell", "bell", "bell", "rise", "fall"};
        char n[PM_LOGGER_TEXT], x[3 * LEVER_TEXT], root[4 * LEVER_TEXT];
        snprintf(n, sizeof n, "%.40s_%d", name, k + 1);
        pm_logger_constant(w, kinds[k], n, SMALL * inertia, PM_LOGGER_OPTIONAL);
        snprintf(x, sizeof x, "(%s - %.60s)", u,
                 add_number(w, "place", n, y->mean + (k < BENDS ? k - BENDS / 2 : 0) * y->deviation,
                            y->deviation, ""));
        pm_logger_constant(w, "width", n, y->deviation, "");
        snprintf(root, sizeof root, "sqrt(%s^2 + width_%s^2)", x, n);
        if (k < BENDS) {
            fprintf(w->model, "%sbell_%s*width_%s*(%s - width_%s))\"\n", first, n, n, root, n);
        } else {
            fprintf(
                w->model,
                "%s%s_%s/2*(%s^2/2 %c (%s*%s + width_%s^2*ln((%s + %s)/width_%s + %.4g))/2))\"\n",
                first, kinds[k], n, x, k == BENDS ? '+' : '-', x, root, n, x, root, n, SHARP);
        }
    }
}

// Writes the co-energy by which the entropy of temperature T depends on position q, or, of lengths
// that store energy together, on their distance from the centre.
static void write_expansion(pm_logger_writer *w, int q, const pm_logger_column *T) {
    const pm_logger_view *v = w->v;
    const pm_logger_column *x = &v->column[q];
    const double size = T->inertia * T->deviation / T->mean;
    double mean = x->mean, square = x->mean * x->mean + x->deviation * x->deviation;
    double spread = x->deviation;
    char both[PM_LOGGER_TEXT], place[PM_LOGGER_LONG_TEXT];
    size_t n = (size_t)snprintf(place, sizeof place, "%.40s", x->name);
    bool distance = false;
    for (int r = q + 1; r < v->nvariable && n < sizeof place; ++r) {
        const pm_logger_column *other = &v->column[r];
        if (v->central[q][r]) {
            n = distance ? n : (size_t)snprintf(place, sizeof place, "sqrt(%.40s^2", x->name);
            n += (size_t)snprintf(place + n, sizeof place - n, " + %.40s^2", other->name);
            square += other->mean * other->mean + other->deviation * other->deviation;
            distance = true;
        }
    }
    if (distance && n < sizeof place) {
        mean = sqrt(square);
        spread = mean / 2;
        snprintf(place + n, sizeof place - n, " + %.4g)", SMALL * SMALL * square);
    }
    snprintf(both, sizeof both, "%.40s_%.40s", x->name, T->name);
    fprintf(w->model, "      - \"%s*(%s*(%s - %.6g)/%.6g", T->name,
            pm_logger_number(w, "expands", both, 0, size), place, mean, spread);
    fprintf(w->model, " + %s*((%s - %.6g)/%.6g)^2", pm_logger_number(w, "widens", both, 0, size),
            place, mean, spread);
    if (x->least > 0 || distance) { // a volume, or a distance
        fprintf(w->model, " + %s*ln(%s/%.6g)", pm_logger_number(w, "fills", both, 0, size), place,
                mean);
    }
    fputs(")\"\n", w->model);
}

// Writes number k of the functions of two positions, or of one, q == r, on which the inertia of a
// chain of links and sliders may depend: waves of angles, of their sums and differences, and powers
// of lengths. Returns false if there is none.
static bool write_reach(const pm_logger_view *v, int q, int r, int k, char text[PM_LOGGER_TEXT]) {
    const pm_logger_column *a = &v->column[q], *b = &v->column[r];
    const char *const wave = k % 2 == 0 ? "cos" : "sin";
    const double first = fmax(fabs(a->least), fabs(a->largest)),
                 second = fmax(fabs(b->least), fabs(b->largest));
    if (a->angle && b->angle && q != r) {
        snprintf(text, PM_LOGGER_TEXT, "%s(%.40s %c %.40s)", wave, a->name, k < 2 ? '+' : '-',
                 b->name);
        return true;
    }
    if (a->angle && b->angle) { // of twice the angle, as of the square of its sine
        snprintf(text, PM_LOGGER_TEXT, k < 2 ? "%s(%.40s)" : "%s(2*%.40s)", wave, a->name);
        return k < 2 || a->twice;
    }
    if (a->angle != b->angle) {
        snprintf(text, PM_LOGGER_TEXT, "%.40s/%.6g*%s(%.40s)", a->angle ? b->name : a->name,
                 a->angle ? second : first, wave, a->angle ? a->name : b->name);
        return k < 2;
    }
    snprintf(text, PM_LOGGER_TEXT, "%.40s*%.40s/%.6g", a->name, b->name, first * second);
    if (q == r && k == 1) {
        snprintf(text, PM_LOGGER_TEXT, "%.40s/%.6g", a->name, first);
    }
    return k < (q == r ? 2 : 1);
}

// Writes the energy of velocities that share an inertia: a sum over all pairs of them.
static void write_shared_energy(pm_logger_writer *w, int part) {
    const pm_logger_view *v = w->v;
    for (int i = 0; i < v->nvariable; ++i) {
        for (int j = i; j < v->nvariable; ++j) {
            const pm_logger_column *y = &v->column[i], *other = &v->column[j];
            const double size = sqrt(y->inertia * other->inertia);
            char entry[PM_LOGGER_TEXT], name[PM_LOGGER_TEXT], reach[PM_LOGGER_TEXT];
            if (y->part != part || other->part != part || !shares_inertia(w, i) ||
                !shares_inertia(w, j)) {
                continue;
            }
            snprintf(entry, sizeof entry, "%.40s_%.40s", y->name, other->name);
            if (i != j) {
                fprintf(w->model, "      - \"(%s", pm_logger_number(w, "mass", entry, 0, size));
            } else if (y->free_scale) {
                fputs("      - \"(1", w->model); // nothing fixes its scale
            } else {
                pm_logger_constant(w, "mass", entry, size, "");
                fprintf(w->model, "      - \"(mass_%s", entry);
            }
            for (int q = 0; q < v->nvariable; ++q) {
                for (int r = q; r < v->nvariable; ++r) {
                    const bool own = pm_logger_is(v, q, part, PM_LOGGER_POSITION) &&
                                     pm_logger_is(v, r, part, PM_LOGGER_POSITION) &&
                                     v->column[q].guess != PM_LOGGER_CYCLIC &&
                                     v->column[r].guess != PM_LOGGER_CYCLIC;
                    static const char *const kinds[] = {"w1", "w2", "w3", "w4"};
                    for (int k = 0; own && k < 4 && write_reach(v, q, r, k, reach); ++k) {
                        snprintf(name, sizeof name, "%.50s_%.30s%s%.30s", entry, v->column[q].name,
                                 q == r ? "" : "_", q == r ? "" : v->column[r].name);
                        fprintf(w->model, " + %s*%s", pm_logger_number(w, kinds[k], name, 0, size),
                                reach);
                    }
                }
            }
            fprintf(w->model, ")*%s*%s%s\"\n", y->name, other->name, i == j ? "/2" : "");
        }
    }
}

// Writes C: the co-energy of velocities, temperatures and the like.
void pm_logger_write_coenergy(pm_logger_writer *w, int part) {
    const int capacity = w->chosen[PM_LOGGER_CAPACITY];
    const bool bends = capacity != CONSTANT_CAPACITY;
    bool some = false, shared = false;
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *y = &w->v->column[c];
        if (y->part != part || y->kind == PM_LOGGER_POSITION || y->kind == PM_LOGGER_CHARGE ||
            y->kind == PM_LOGGER_AMOUNT) {
            continue;
        }
        const double own = y->inertia;
        if (!some) {
            fputs("    coenergy:\n", w->model);
        }
        some = true;
        if (y->kind == PM_LOGGER_TEMPERATURE) {
            write_capacity(w, y, bends);
        } else if (shares_inertia(w, c)) {
            shared = true;
        } else {
            const bool turns = w->v->turns[c];
            fputs(turns ? "      - \"(" : "      - \"", w->model);
            if (!y->free_scale) {
                pm_logger_constant(w, "inertia", y->name, own, "");
                fprintf(w->model, "inertia_%s*", y->name);
            }
            if (turns) {
                fputs("exp(0", w->model);
                write_lever(w, y->name, "", part, true, -1, 0);
                fputs(")", w->model);
            }
            // A mass at a distance from an axis has an inertia that grows with its square.
            for (int q = 0; q < w->v->nvariable && turns; ++q) {
                const pm_logger_column *x = &w->v->column[q];
                if (pm_logger_is(w->v, q, part, PM_LOGGER_POSITION) && !x->angle && q != y->mate) {
                    char both[PM_LOGGER_TEXT];
                    snprintf(both, sizeof both, "%.40s_by_%.40s", y->name, x->name);
                    pm_logger_constant(w, "swing", both, SMALL * own, PM_LOGGER_OPTIONAL);
                    fprintf(w->model, " + swing_%s*(%s/%.6g)^2", both, x->name,
                            fmax(fabs(x->least), fabs(x->largest)));
                }
            }
            fputs(turns ? ")*" : "", w->model);
            bool shares = false;
            for (int j = c + 1; j < w->v->nvariable; ++j) {
                if (w->v->mutual[c][j] != 0 ||
                    (w->chosen[PM_LOGGER_SHARING] > 0 && pm_logger_may_share(w->v, c, j))) {
                    char both[PM_LOGGER_TEXT];
                    snprintf(both, sizeof both, "%.40s_%.40s", y->name, w->v->column[j].name);
                    fprintf(w->model, "%s%s + %s*%s", shares ? "" : "(", shares ? "" : y->name,
                            pm_logger_number(w, "mutual", both, w->v->mutual[c][j], 1),
                            w->v->column[j].name);
                    shares = true;
                }
            }
            fprintf(w->model, "%s^2/2\"%s\n", shares ? ")" : y->name,
                    y->free_scale ? "   # nothing fixes its scale, which is 1" : "");
            if (bends && y->kind == PM_LOGGER_LEVEL) {
                pm_logger_constant(w, "wider", y->name, SMALL * own, PM_LOGGER_OPTIONAL);
                fprintf(w->model, "      - \"wider_%s*%s^3/%.4g\"\n", y->name, y->name,
                        2 * 3 * y->largest);
            } else if (bends && (y->bent || capacity == LEARNED_CAPACITY) &&
                       !pm_logger_is_velocity(y) && y->relaxes == 0) {
                write_bends(w, y, own, turns);
            }
        }
    }
    for (int q = 0; q < w->v->nvariable; ++q) {
        for (int t = 0; t < w->v->nvariable; ++t) {
            const pm_logger_column *x = &w->v->column[q], *T = &w->v->column[t];
            if (x->part == part && w->v->expands[q][t] && pm_logger_leader(w->v, q) == q) {
                write_expansion(w, q, T);
            }
        }
    }
    if (shared && w->chosen[PM_LOGGER_INERTIA] != LEARNED_INERTIA &&
        pm_logger_count(w->v, part, PM_LOGGER_POSITION) <= MOST_SUMMED) {
        write_shared_energy(w, part);
    } else if (shared) {
        double first = 0;
        bool listed = false;
        fputs("      - {inertia: {of: [", w->model);
        for (int c = 0; c < w->v->nvariable; ++c) {
            const pm_logger_column *y = &w->v->column[c];
            if (y->part == part && shares_inertia(w, c)) {
                first = !listed && y->free_scale ? 1 : first;
                fprintf(w->model, "%s%s", pm_logger_separate(&listed), y->name);
            }
        }
        fputs("], features: [", w->model);
        write_position_features(w, part, "");
        fputs("], hidden: [6], skip: quadratic", w->model);
        fputs(first > 0 ? ", first: 1.0}}\n" : "}}\n", w->model);
    }
}

void pm_logger_cell_resistance(char *text, size_t size, const pm_logger_view *v,
                               const pm_logger_column *cell, const char *of, const char *at) {
    const char *name = cell->name;
    const int T = v->thermometer[cell->part];
    int n = snprintf(
        text, size, "%sresistance_%s*(1 + %sdrained_%s*exp((%.6g - %s%s)/(%.4g + %sdepth_%s)))", of,
        name, of, name, cell->least, at, name, DRAINED * (cell->largest - cell->least), of, name);
    if (T >= 0 && n < (int)size) {
        snprintf(text + n, size - (size_t)n, "*exp(%swarms_%s*(%.6g - %s%s))", of, name,
                 v->column[T].mean, at, v->column[T].name);
    }
}

// Adds the constants of the resistance of a cell, which its voltage and its heat have in common,
// unless they exist already.
static void add_resistance(pm_logger_writer *w, const pm_logger_column *cell) {
    const bool warms = w->v->thermometer[cell->part] >= 0;
    double current = 1;
    for (int u = w->v->nvariable; u < w->v->ncolumn; ++u) {
        current = w->v->column[u].id == cell->current ? w->v->column[u].deviation : current;
    }
    const char *const kind[] = {"resistance", "drained",  "depth",
                                "activation", "exchange", "warms"};
    const double start[] = {fmax(fabs(cell->resistance), LEAST_CONSTANT),
                            SMALL,
                            SMALL * (cell->largest - cell->least),
                            SMALL * current,
                            current,
                            WARMS};
    const int nkind = (int)(sizeof kind / sizeof *kind) - !warms; // the last one is of the heat
    for (int k = 0; k < nkind; ++k) {
        pm_logger_constant(w, kind[k], cell->name, start[k], PM_LOGGER_SHARED);
    }
}

// Returns true if two positions may have a spring between them: lengths, and angles that do not
// turn against each other.
static bool has_spring(const pm_logger_view *v, int i, int j) {
    return v->lever[i][j] != 0 &&
           (v->lever[i][j] != 1 || !v->column[i].angle || v->apart[i][j] < PM_LOGGER_TURN);
}

// Returns the lever of a spring between two positions, q < r, as a formula names it.
static const char *lever_of(pm_logger_writer *w, char text[PM_LOGGER_TEXT], int q, int r) {
    const double lever = w->v->lever[q][r];
    char both[PM_LOGGER_TEXT];
    snprintf(both, sizeof both, "%.40s_%.40s", w->v->column[q].name, w->v->column[r].name);
    pm_logger_constant(w, "lever", both, lever, PM_LOGGER_SHARED);
    snprintf(text, PM_LOGGER_TEXT, "%slever_%.90s", lever < 0 ? "-" : "", both);
    return text;
}

// Writes the energies of lengths that store energy together: functions of a distance to a learned
// place, which may be elliptic.
static void write_central(pm_logger_writer *w, int part) {
    const pm_logger_view *v = w->v;
    for (int q = 0; q < v->nvariable; ++q) {
        bool some = false;
        double d = 0;
        for (int r = q; r < v->nvariable; ++r) {
            const pm_logger_column *x = &v->column[r];
            const bool own = pm_logger_is(v, r, part, PM_LOGGER_POSITION);
            if (own && pm_logger_leader(v, r) == q && (r == q || v->central[q][r])) {
                d = fmax(d, fmax(fabs(x->least), fabs(x->largest)));
                some = some || r > q;
            }
        }
        if (!some) {
            continue;
        }
        char distance[4 * PM_LOGGER_LONG_TEXT] = "sqrt(";
        size_t n = strlen(distance);
        for (int r = q; r < v->nvariable && n < sizeof distance; ++r) {
            const pm_logger_column *x = &v->column[r];
            if (r == q || v->central[q][r]) {
                const char *place = pm_logger_number(w, "away", x->name, 0, x->deviation);
                n += (size_t)snprintf(distance + n, sizeof distance - n, "%s(%s - %s)^2",
                                      r > q ? " + " : "", x->name, place);
                if (r > q && n < sizeof distance) {
                    pm_logger_constant(w, "aspect", x->name, 1, "");
                    n += (size_t)snprintf(distance + n, sizeof distance - n, "*aspect_%.40s",
                                          x->name);
                }
            }
        }
        const char *name = v->column[q].name;
        const double size = energy_of(&v->column[v->column[q].mate]);
        pm_logger_constant(w, "core", name, SMALL * d, "");
        if (n < sizeof distance) {
            snprintf(distance + n, sizeof distance - n, " + core_%.40s^2)/%.6g", name, d);
        }
        static const char *const kinds[] = {"radius1", "radius2", "radius3", "radius4", "radius5"};
        fputs("      - \"", w->model);
        for (int k = 0; k < 4; ++k) {
            fprintf(w->model, "%s%s*(%s)^%d", k > 0 ? " + " : "",
                    pm_logger_number(w, kinds[k], name, 0, size), distance, k + 1);
        }
        fprintf(w->model, " + %s*ln(%s)", pm_logger_number(w, kinds[4], name, 0, size), distance);
        pm_logger_constant(w, "attraction", name, 1, ""); // its power
        fprintf(w->model, " + %s*exp(-attraction_%s*ln(%s))\"\n",
                pm_logger_number(w, "pull", name, v->orbits[q] ? -size : 0, size), name, distance);
    }
}

// Writes V, the energy of positions.
void pm_logger_write_energy(pm_logger_writer *w, int part) {
    const int positions = pm_logger_count(w->v, part, PM_LOGGER_POSITION);
    bool feeds = false;
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *y = &w->v->column[c];
        feeds = feeds || (y->part == part && (y->feeds || y->rubs));
    }
    const int charges = pm_logger_count(w->v, part, PM_LOGGER_CHARGE);
    const int amounts = pm_logger_count(w->v, part, PM_LOGGER_AMOUNT);
    if (positions + charges + amounts == 0 && !feeds) {
        return;
    }
    fputs("    energy:\n", w->model);
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *q = &w->v->column[c];
        if (q->part != part || q->kind != PM_LOGGER_CHARGE) {
            continue;
        }
        // The voltage of a charge is a polynomial with smooth steps.
        const double d = fmax(fabs(q->least), fabs(q->largest));
        const char *name = q->name;
        add_resistance(w, q);
        (void)pm_logger_number(w, "u0", name, q->voltage, 1);
        (void)pm_logger_number(w, "u1", name, q->slope * d, 1);
        fprintf(w->model, "      - \"u0_%s*%s + u1_%s*%s^2/%.6g\"\n", name, name, name, name,
                2 * d);
        for (int k = 2; k <= POWERS_OF_CHARGE; ++k) {
            char kind[] = "u0";
            kind[1] = (char)('0' + k);
            (void)pm_logger_number(w, kind, name, 0, 1);
            fprintf(w->model, "      - \"%s_%s*%.6g*(%s/%.6g)^%d\"\n", kind, name, d / (k + 1),
                    name, d, k + 1);
        }
        const double apart = (q->largest - q->least) / KNEES_OF_CHARGE;
        for (int k = 0; k < KNEES_OF_CHARGE; ++k) {
            char kind[] = "knee1";
            kind[strlen(kind) - 1] = (char)('1' + k);
            (void)pm_logger_number(w, kind, name, 0, 1);
            fprintf(w->model, "      - \"%s_%s*sqrt((%s - %.6g)^2 + %.6g)\"\n", kind, name, name,
                    q->least + (k + MIDDLE) * apart, MIDDLE * apart * apart);
        }
    }
    if (positions == 0 && !feeds) {
        return;
    }
    for (int c = 0; c < w->v->nvariable; ++c) {
        if (w->v->column[c].part == part && w->v->column[c].feeds) {
            fprintf(w->model, "      - \"%.4g*z_%s\"   # of the height through which fluid falls\n",
                    pm_logger_highest(w->v), w->v->column[c].name);
        }
        if (w->v->column[c].part == part && w->v->column[c].rubs) {
            fprintf(w->model, "      - \"%.6g*s_%s\"   # at the temperature of the surroundings\n",
                    w->v->bath, w->v->column[c].name);
        }
    }
    if (positions > 0 && w->chosen[PM_LOGGER_POTENTIAL] == NETWORK_OF_POSITIONS) {
        fputs("      - {features: [", w->model);
        write_position_features(w, part, "");
        fputs("], hidden: [8], skip: quadratic}\n", w->model);
        return;
    }
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *q = &w->v->column[c];
        if (!pm_logger_is(w->v, c, part, PM_LOGGER_POSITION)) {
            continue;
        }
        const pm_logger_column *v = &w->v->column[q->mate];
        double stiffness = q->guided ? 0 : -v->inertia * w->v->coupling[q->mate][c] / q->ratio;
        for (int j = 0; j < w->v->nvariable; ++j) { // what springs to other positions have of it
            stiffness -=
                j != c && pm_logger_is(w->v, j, part, PM_LOGGER_POSITION) && has_spring(w->v, c, j)
                    ? w->v->column[q->mate].inertia * w->v->coupling[q->mate][j] *
                          w->v->lever[c][j] / q->ratio
                    : 0;
        }
        fputs("      - \"", w->model);
        if (q->waves) {
            const double start[] = {-stiffness * sin(q->mean), -stiffness * cos(q->mean)};
            for (int k = 0; k < 2 * q->harmonics; ++k) {
                char kind[] = "sin1";
                harmonic(kind, k);
                fprintf(w->model, "%s%s*%.3s(%d*%s)", k > 0 ? " + " : "",
                        pm_logger_number(w, kind, q->name, k < 2 ? start[k] : 0, energy_of(v)),
                        kind, 1 + k / 2, q->name);
            }
        }
        const bool more = w->chosen[PM_LOGGER_POTENTIAL] == SPRINGS_OF_ANGLES;
        if (!q->waves || q->springs || (more && pm_logger_may_spring(q))) {
            const double d = fmax(fabs(q->least), fabs(q->largest));
            const double push = q->guided ? 0 : -v->inertia * v->constant * d / q->ratio;
            const double start[] = {push, stiffness * d * d / 2};
            static const char *const kinds[] = {"k1", "k2", "k3", "k4"};
            for (int k = 0; k < 4; ++k) {
                const double begin = k < 2 && !q->waves ? start[k] : 0;
                fprintf(w->model, "%s%s*(%s/%.6g)^%d", k > 0 || q->waves ? " + " : "",
                        pm_logger_number(w, kinds[k], q->name, begin, energy_of(v)), q->name, d,
                        k + 1);
            }
            // A spring that softens or hardens at some place.
            const char *bend = pm_logger_number(w, "bend", q->name, 0, energy_of(v));
            const char *place = bounded_place(w, "place", q->name, q->mean, q->least, q->largest);
            pm_logger_constant(w, "width", q->name, q->deviation, "");
            fprintf(w->model, " + %s*sqrt((%s - %s)^2 + width_%s^2)/%.6g", bend, q->name, place,
                    q->name, d);
        }
        fputs("\"\n", w->model);
    }
    write_central(w, part);
    // What two positions store together: a spring between them, angles that add up, or a weight
    // that slides along a rod.
    for (int i = 0; i < w->v->nvariable; ++i) {
        for (int j = i + 1; j < w->v->nvariable; ++j) {
            const pm_logger_column *a = &w->v->column[i], *b = &w->v->column[j];
            if (!pm_logger_is(w->v, i, part, PM_LOGGER_POSITION) ||
                !pm_logger_is(w->v, j, part, PM_LOGGER_POSITION)) {
                continue;
            }
            char both[PM_LOGGER_TEXT];
            snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
            const double size = energy_of(&w->v->column[a->mate]), lever = w->v->lever[i][j];
            const bool geared = lever != 0 && lever != 1;
            // Lengths of one unit are joined by springs, if by anything.
            const bool alone = a->angle && b->angle ? !a->waves && !b->waves
                                                    : pm_unit_equal(&a->dimension, &b->dimension);
            char reach[PM_LOGGER_TEXT];
            for (int k = 0; k < 4 && !geared && !alone && write_reach(w->v, i, j, k, reach); ++k) {
                static const char *const kinds[] = {"w1", "w2", "w3", "w4"};
                fprintf(w->model, "      - \"%s*%s\"\n",
                        pm_logger_number(w, kinds[k], both, 0, size), reach);
            }
            if (has_spring(w->v, i, j)) {
                const double d = w->v->apart[i][j];
                const double spring = w->v->column[a->mate].inertia * w->v->coupling[a->mate][j] /
                                      (a->ratio * lever) * d * d / 2;
                char distance[PM_LOGGER_LONG_TEXT], factor[PM_LOGGER_TEXT];
                snprintf(distance, sizeof distance, "%s - %s", a->name, b->name);
                if (geared) {
                    snprintf(distance, sizeof distance, "%s*(%s - %.6g) - (%s - %.6g)",
                             lever_of(w, factor, i, j), a->name, a->mean, b->name, b->mean);
                }
                static const char *const kinds[] = {"b2", "b3", "b4"};
                for (int k = 0; k < 3; ++k) {
                    fprintf(w->model, "%s%s*((%s)/%.6g)^%d", k > 0 ? " + " : "      - \"",
                            pm_logger_number(w, kinds[k], both, k == 0 ? spring : 0, size),
                            distance, d, k + 2);
                }
                const char *bend = pm_logger_number(w, "bend", both, 0, size);
                const char *place = bounded_place(w, "place", both, 0, -d, d);
                pm_logger_constant(w, "width", both, MIDDLE * d, "");
                fprintf(w->model, " + %s*sqrt((%s - %s)^2 + width_%s^2)/%.6g\"\n", bend, distance,
                        place, both, d);
            }
            // Three angles store energy together, as the weight of the last link of a chain does.
            const bool sums = a->waves && b->waves && positions <= MOST_SUMMED;
            for (int c = j + 1; c < w->v->nvariable && sums; ++c) {
                const pm_logger_column *third = &w->v->column[c];
                const bool own = pm_logger_is(w->v, c, part, PM_LOGGER_POSITION) && third->waves;
                for (int k = 0; k < 4 && own; ++k) {
                    static const char *const kinds[][2] = {
                        {"cos1", "sin1"}, {"cos2", "sin2"}, {"cos3", "sin3"}, {"cos4", "sin4"}};
                    char all[PM_LOGGER_TEXT], sum[PM_LOGGER_TEXT];
                    snprintf(all, sizeof all, "%.60s_%.30s", both, third->name);
                    snprintf(sum, sizeof sum, "%.40s %c %.40s %c %.40s", a->name, k < 2 ? '+' : '-',
                             b->name, k % 2 == 0 ? '+' : '-', third->name);
                    fprintf(w->model, "      - \"%s*cos(%s)",
                            pm_logger_number(w, kinds[k][0], all, 0, size), sum);
                    fprintf(w->model, " + %s*sin(%s)\"\n",
                            pm_logger_number(w, kinds[k][1], all, 0, size), sum);
                }
            }
        }
    }
}

void pm_logger_write_turns(pm_logger_writer *w, const int *parts, bool *some) {
    const pm_logger_view *v = w->v;
    const char *const first = "    reversible: {given: [";
    const char *const end[] = {parts[0] == parts[1] ? "" : "a.", parts[0] == parts[1] ? "" : "b."};
    for (int q = 0; q < v->nvariable; ++q) {
        for (int i = 0; i < v->nvariable; ++i) {
            const int home = v->column[q].part, away = v->column[i].part;
            const bool here =
                (home == parts[0] && away == parts[1]) || (home == parts[1] && away == parts[0]);
            if (!here || !pm_logger_guides(v, q, i)) {
                continue;
            }
            fprintf(w->model, "%s[%s%s, %s%s, \"", *some ? ", " : first, end[home != parts[0]],
                    v->column[q].name, end[away != parts[0]], v->column[i].name);
            *some = true;
            bool sum = false;
            for (int k = 0; k < v->nguide; ++k) {
                const pm_logger_guide *g = &v->guide[k];
                const pm_logger_column *angle = &v->column[g->angle];
                const char *at = end[angle->part != parts[0]];
                char name[PM_LOGGER_TEXT];
                if (g->position != q || g->velocity != i) {
                    continue;
                }
                snprintf(name, sizeof name, "%.30s_%.30s_%d", v->column[q].name, v->column[i].name,
                         k);
                fputs(sum ? " + " : "", w->model);
                sum = true;
                if (fabs(g->factor) == 1) {
                    fprintf(w->model, "%.1f", g->factor);
                } else {
                    fputs(pm_logger_number(w, "guide", name, g->factor, fabs(g->factor)), w->model);
                }
                if (g->function == 'x') {
                    fprintf(w->model, "*%s%s", at, angle->name);
                } else if (g->function != '1') {
                    fprintf(w->model, "*%s(%d*%s%s", g->function == 's' ? "sin" : "cos",
                            g->harmonic, at, angle->name);
                    if (g->other >= 0) {
                        fprintf(w->model, " %c %s%s", g->sign > 0 ? '+' : '-', at,
                                v->column[g->other].name);
                    }
                    fputs(")", w->model);
                }
            }
            fputs("\"]", w->model);
        }
    }
    for (int k = 0; k < v->ncarrier; ++k) {
        const pm_logger_carrier *c = &v->carrier[k];
        if (!pm_logger_carries(v, c, parts[0], parts[1])) {
            continue;
        }
        const pm_logger_column *flow = &v->column[c->flow];
        const pm_logger_column *to[] = {&v->column[c->from], &v->column[c->to]};
        char both[PM_LOGGER_TEXT];
        snprintf(both, sizeof both, "%.30s_%.30s_%.30s", flow->name, to[0]->name, to[1]->name);
        const char *carried = pm_logger_number(w, "carried", both, c->entropy, fabs(c->entropy));
        for (int n = 0; n < 2; ++n) {
            fprintf(w->model, "%s[%s%s, %s%s, \"%s%s\"]", *some ? ", " : first,
                    end[flow->part != parts[0]], flow->name, end[to[n]->part != parts[0]],
                    to[n]->name, n == 0 ? "" : "-", carried);
            *some = true;
        }
    }
}

// Writes what couples positions with velocities, and co-energies of different kinds.
void pm_logger_write_reversible(pm_logger_writer *w, int part) {
    bool some = false;
    for (int i = 0; i < w->v->nvariable; ++i) {
        const pm_logger_column *a = &w->v->column[i];
        if (a->part != part) {
            continue;
        }
        if (a->kind == PM_LOGGER_POSITION && !a->guided && w->v->column[a->mate].part == part) {
            fprintf(w->model, "%s[%s, %s, ", some ? ", " : "    reversible: {given: [", a->name,
                    w->v->column[a->mate].name);
            if (fabs(a->ratio) == 1) {
                fprintf(w->model, "%.1f]", a->ratio);
            } else {
                fprintf(w->model, "\"%s\"]",
                        pm_logger_number(w, "ratio", a->name, a->ratio, fabs(a->ratio)));
            }
            some = true;
        }
        for (int j = i + 1; j < w->v->nvariable; ++j) {
            const pm_logger_column *b = &w->v->column[j];
            const bool crank = w->v->crank[i][j] || w->v->crank[j][i];
            const double rate = w->v->moves[i][j] != 0 ? w->v->moves[i][j] : -w->v->moves[j][i];
            if (b->part == part && rate != 0) {
                fprintf(w->model, "%s[%s, %s, %.6g]", some ? ", " : "    reversible: {given: [",
                        a->name, b->name, rate);
                some = true;
            }
            if (b->part == part && (w->v->gyrates[i][j] || w->v->circles[i][j])) {
                char both[PM_LOGGER_TEXT];
                snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
                fprintf(
                    w->model, "%s[%s, %s, \"%s", some ? ", " : "    reversible: {given: [", a->name,
                    b->name,
                    pm_logger_number(w, "circling", both,
                                     w->v->circles[i][j] ? a->inertia * w->v->coupling[i][j] : 0,
                                     pm_logger_between(w, a, b)));
                for (int k = 0; k < w->v->nvariable && w->v->gyrates[i][j]; ++k) {
                    const pm_logger_column *y = &w->v->column[k];
                    if (pm_logger_is_velocity(y) && y->part == part) {
                        char by[2 * PM_LOGGER_TEXT];
                        snprintf(by, sizeof by, "%.60s_by_%.30s", both, y->name);
                        fprintf(w->model, " + %s*%s",
                                pm_logger_number(w, "gyration", by, 0,
                                                 pm_logger_between(w, a, b) / y->deviation),
                                y->name);
                    }
                }
                fputs("\"]", w->model);
                some = true;
            }
            if (b->part == part && (crank || pm_logger_is_coupled(w->v, i, j, false))) {
                char both[PM_LOGGER_TEXT];
                snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
                fprintf(
                    w->model, "%s[%s, %s, \"%s", some ? ", " : "    reversible: {given: [", a->name,
                    b->name,
                    pm_logger_number(
                        w, "coupling", both,
                        (a->inertia * w->v->coupling[i][j] - b->inertia * w->v->coupling[j][i]) / 2,
                        pm_logger_between(w, a, b)));
                if (crank) {
                    write_lever(w, both, "", part, false, -1, pm_logger_between(w, a, b));
                }
                // Flows couple others, as the currents of a machine do that its magnets turn.
                const bool flows =
                    w->chosen[PM_LOGGER_COUPLING] == LEARNED_COUPLING || w->v->multiplies[i][j];
                for (int k = 0; k < w->v->nvariable && flows; ++k) {
                    const pm_logger_column *y = &w->v->column[k];
                    if (pm_logger_is(w->v, k, part, PM_LOGGER_FLOW)) {
                        char by[2 * PM_LOGGER_TEXT];
                        snprintf(by, sizeof by, "%.60s_by_%.30s", both, y->name);
                        const double size = pm_logger_between(w, a, b) / y->deviation;
                        const double most = fmax(fabs(y->least), fabs(y->largest));
                        fprintf(w->model, " + (%s", pm_logger_number(w, "flux", by, 0, size));
                        fprintf(w->model, " + %s*(%s/%.6g)^2)*%s",
                                pm_logger_number(w, "bent", by, 0, size), y->name, most, y->name);
                        pm_logger_constant(w, "saturates", by, 1, "");
                        fprintf(w->model, "/sqrt(1 + saturates_%s*(%s/%.6g)^2)", by, y->name, most);
                    }
                }
                fputs("\"]", w->model);
                some = true;
            }
        }
    }
    const int alone[] = {part, part};
    pm_logger_write_turns(w, alone, &some);
    fputs(some ? "]}\n" : "", w->model);
}

// Writes a positive factor that depends on the variable x, which y describes: an exponential of
// bends with learned places and widths. It begins with 1. With the variable `sign`, which `of`
// describes, the bends depend on the sign of that variable, too.
static void write_factor(pm_logger_writer *w, const char *name, const char *x,
                         const pm_logger_column *y, const char *sign, const pm_logger_column *of) {
    const bool wavy = w->chosen[PM_LOGGER_FRICTION] == WAVY_FRICTION;
    const int bends = wavy ? MOST_BENDS : BENDS;
    const double apart = wavy ? (y->largest - y->least) / MOST_BENDS : y->deviation;
    const double first = wavy ? y->least + MIDDLE * apart : y->mean - BENDS / 2 * y->deviation;
    fputs("*exp(0", w->model);
    for (int k = 0; k < bends; ++k) {
        char numbered[PM_LOGGER_TEXT];
        snprintf(numbered, sizeof numbered, "%.80s_%d", name, k + 1);
        const char *n = numbered;
        const char *bend = logarithm(w, "bend", n, MOST_BEND);
        const char *middle = add_number(w, "middle", n, first + k * apart, apart, "");
        pm_logger_constant(w, "range", n, apart, "");
        if (sign == NULL) {
            fprintf(w->model, " + %s", bend);
        } else {
            fprintf(w->model, " + (%s + %s*%s/sqrt(%s^2 + %.4g))", bend,
                    pm_logger_number(w, "sign", n, 0, 1), sign, sign,
                    DRY * DRY * of->deviation * of->deviation);
        }
        fprintf(w->model, "*(%s - %s)/sqrt((%s - %s)^2 + range_%s^2)", x, middle, x, middle, n);
    }
    fputs(")", w->model);
}

// Writes a positive factor that grows with an input, to which it is proportional at first.
static void write_opening(pm_logger_writer *w, const char *name, const pm_logger_column *input) {
    char opening[PM_LOGGER_TEXT];
    snprintf(opening, sizeof opening, "opening_%.80s", name);
    fputs("*|b.dE.x|", w->model);
    write_factor(w, opening, "b.dE.x", input, NULL, NULL);
}

// Writes a pair that conducts heat between two temperatures, or a temperature and a bath: x and y
// are the names of the groups with their prefixes, dx and dy those of their co-energies. The
// conductance is the sum of a power of the temperature, as metals and insulators have, of that of
// radiation, and of that of natural convection, a power of the difference of the temperatures.
void pm_logger_write_conduction(pm_logger_writer *w, const char *name, const char *x, const char *y,
                                const char *dx, const char *dy, double start,
                                const pm_logger_column *opening) {
    const double T0 = ROOM_TEMPERATURE;
    pm_logger_constant(w, "conductance", name, start, PM_LOGGER_OPTIONAL);
    fprintf(w->model, "[%s, %s, \"(conductance_%s", x, y, name);
    if (w->chosen[PM_LOGGER_CONDUCTION] == RADIATION) {
        fprintf(w->model, "*exp(%s*ln((%s + %s)/%.6g))",
                logarithm(w, "warming", name, MOST_WARMING), dx, dy, 2 * T0);
        pm_logger_constant(w, "radiation", name, SMALL * fabs(start), PM_LOGGER_OPTIONAL);
        fprintf(w->model, " + radiation_%s*(%s + %s)*(%s^2 + %s^2)/%.6g", name, dx, dy, dx, dy,
                4 * T0 * T0 * T0);
    }
    if (w->chosen[PM_LOGGER_CONDUCTION] <= CONVECTION) {
        pm_logger_constant(w, "convection", name, SMALL * fabs(start), PM_LOGGER_OPTIONAL);
        pm_logger_constant(w, "power", name, CONVECTION_POWER / 2, "");
        fprintf(w->model, " + convection_%s*exp(power_%s*ln((%s - %s)^2 + %.4g))", name, name, dx,
                dy, STILL * STILL);
    }
    fputs(")", w->model);
    if (opening != NULL) {
        write_opening(w, name, opening);
    }
    fprintf(w->model, "*%s/%s\"]", dy, dx);
}

void pm_logger_write_gain(pm_logger_writer *w, const char *name, const pm_logger_action *action) {
    const pm_logger_column *input = &w->v->column[action->input];
    const pm_logger_column *y = &w->v->column[action->target];
    const double size = pm_logger_rate(w, y) / (input->deviation > 0 ? input->deviation : 1);
    fprintf(w->model, "(%s", pm_logger_number(w, "gain", name, action->gain, size));
    if (action->lever) {
        write_lever(w, name, "a.", y->part, true, -1, size);
    }
    fputs(")", w->model);
    if (action->valve) {
        char x[PM_LOGGER_TEXT], opening[PM_LOGGER_TEXT];
        snprintf(x, sizeof x, "a.%.40s", y->name);
        snprintf(opening, sizeof opening, "opening_%.80s", name);
        write_factor(w, name, x, y, "b.dE.x", input);
        write_factor(w, opening, "b.dE.x", input, NULL, NULL);
    }
}

void pm_logger_write_heat(pm_logger_writer *w, char *flow, char *lost, size_t size,
                          const char *name, const pm_logger_action *action) {
    const pm_logger_column *input = &w->v->column[action->input];
    const pm_logger_column *y = &w->v->column[action->target], *cell = NULL;
    const double most = fmax(-input->least, input->largest), gain = fabs(action->gain);
    const pm_unit ampere = pm_unit_parse("A");
    *lost = '\0';
    for (int c = 0; c < w->v->nvariable; ++c) {
        const pm_logger_column *other = &w->v->column[c];
        const bool own = other->seen != NULL && other->current == input->id &&
                         action->target == w->v->thermometer[other->part];
        cell = own ? other : cell;
    }
    if (cell == NULL && pm_unit_equal(&input->dimension, &ampere)) {
        const double edge = SMALL * input->deviation;
        snprintf(flow, size, "%s/%.6g", pm_logger_number(w, "carried", name, 0, gain), y->mean);
        if (!has_constant(w, "square", name)) {
            pm_logger_constant(w, "square", name, SMALL * gain, PM_LOGGER_OPTIONAL);
            pm_logger_constant(w, "drop", name, SMALL * gain, PM_LOGGER_OPTIONAL);
        }
        snprintf(lost, size, "(square_%s/%.4g + drop_%s/sqrt(b.dE.x^2 + %.4g))*a.dE.%s", name, most,
                 name, edge * edge, y->name);
        return;
    }
    if (cell == NULL && input->least >= 0) {
        pm_logger_constant(w, "gain", name, gain, PM_LOGGER_OPTIONAL);
        snprintf(flow, size, "(gain_%s)/a.dE.%s", name, y->name);
        return;
    }
    const char *sign = pm_logger_number(w, "sign", name, 0, gain);
    if (cell == NULL) {
        pm_logger_constant(w, "square", name, SMALL * gain, PM_LOGGER_OPTIONAL);
        snprintf(flow, size, "(%s + square_%s*b.dE.x/%.4g)/a.dE.%s", sign, name, most, y->name);
        return;
    }
    char resistance[PM_LOGGER_LONG_TEXT];
    add_resistance(w, cell);
    pm_logger_cell_resistance(resistance, sizeof resistance, w->v, cell, "", "a.");
    char current[4 * PM_LOGGER_LONG_TEXT];
    pm_logger_cell_current(current, sizeof current, cell, "", "b.dE.x");
    snprintf(flow, size, "(%s + %s*a.%s/%.4g + %s*%s)/a.dE.%s", sign,
             pm_logger_number(w, "by_charge", name, 0, gain), cell->name,
             fmax(fabs(cell->least), fabs(cell->largest)), resistance, current, y->name);
}

void pm_logger_write_resistance(pm_logger_writer *w, const char *name, const char *x,
                                const pm_logger_column *y, const pm_logger_column *other,
                                double start, const pm_logger_column *opening) {
    pm_logger_column drop = *y;
    const pm_unit pressure = pm_unit_parse("Pa");
    const double d = fmax(fabs(y->least), fabs(y->largest)), dry = DRY * y->deviation;
    const int chosen = w->chosen[PM_LOGGER_FRICTION];
    const int shown = !y->damped ? LINEAR_FRICTION : !y->curved ? DRY_FRICTION : BENT_FRICTION;
    const int law = chosen == BENT_FRICTION && other == NULL ? shown : chosen;
    pm_logger_constant(w, "linear", name, start, PM_LOGGER_OPTIONAL);
    fprintf(w->model, "(linear_%s", name);
    if (law <= QUADRATIC_FRICTION) {
        pm_logger_constant(w, "quadratic", name, SMALL * start, PM_LOGGER_OPTIONAL);
        const bool one = strchr(x, ' ') == NULL;
        fprintf(w->model,
                one ? " + quadratic_%s*|%s|/%.4g" : " + quadratic_%s*sqrt((%s)^2 + %.4g)/%.4g",
                name, x, one ? d : dry * dry, d);
        pm_logger_constant(w, "cubic", name, SMALL * start, PM_LOGGER_OPTIONAL);
        fprintf(w->model, " + cubic_%s*(%s)^2/%.4g", name, x, d * d);
    }
    if (law <= DRY_FRICTION) {
        // Steps of dt must resolve how friction changes at rest, else the fit begins unstable.
        const double fastest = SMALL * fabs(start) * d * w->v->dataset->dt / y->inertia;
        pm_logger_constant(w, "dry", name, SMALL * start, PM_LOGGER_OPTIONAL);
        pm_logger_constant(w, "width", name, fmax(dry, fastest), ""); // of the step at rest
        fprintf(w->model, " + dry_%s*%.4g/sqrt((%s)^2 + width_%s^2)", name, d, x, name);
        if (pm_logger_is_velocity(y)) { // what sticks falls with the velocity (Stribeck)
            pm_logger_constant(w, "sticking", name, SMALL * start, PM_LOGGER_OPTIONAL);
            pm_logger_constant(w, "speed", name, y->deviation / 2, "");
            fprintf(w->model, " + sticking_%s/(1 + (%s)^2/speed_%s^2)", name, x, name);
        }
    }
    if (law <= DRY_FRICTION &&
        (pm_unit_equal(&y->dimension, &pressure) || y->kind == PM_LOGGER_LEVEL)) {
        // An orifice: the flow is the root of the difference of pressures, or of levels.
        pm_logger_constant(w, "root", name, SMALL * start, PM_LOGGER_OPTIONAL);
        pm_logger_constant(w, "round", name, dry, "");
        fprintf(w->model, " + root_%s*%.4g/sqrt(sqrt((%s)^2 + round_%s^2))", name, sqrt(d), x,
                name);
    }
    fputs(")", w->model);
    const bool both = other != NULL || fmin(-y->least, y->largest) > SMALL * d;
    if (law <= DRY_FRICTION && pm_logger_is_velocity(y) && both) { // another one in each direction
        fprintf(w->model, "*exp(%s*(%s)/sqrt((%s)^2 + width_%s^2))",
                logarithm(w, "one_way", name, MOST_ONE_WAY), x, x, name);
    }
    if (law <= WAVY_FRICTION && !pm_logger_is_velocity(y)) {
        if (other != NULL) {
            drop.mean -= other->mean;
            drop.least -= other->largest;
            drop.largest -= other->least;
        }
        write_factor(w, name, x, &drop, NULL, NULL);
    }
    if (opening != NULL) {
        write_opening(w, name, opening);
    }
}

// Writes to `x` the speed of the velocities whose positions store energy together, as drag depends
// on it, and returns the first of them. Of other velocities x is the velocity itself.
static const pm_logger_column *write_speed(const pm_logger_writer *w, int c, const char *of,
                                           char *x, size_t size) {
    const pm_logger_view *v = w->v;
    const pm_logger_column *y = &v->column[c], *first = y;
    size_t n = 0;
    for (int q = 0; q < v->nvariable && y->mate >= 0 && n < size; ++q) {
        const pm_logger_column *place = &v->column[q];
        const bool own = place->kind == PM_LOGGER_POSITION && place->part == y->part &&
                         pm_logger_leader(v, q) == pm_logger_leader(v, y->mate) && !place->guided;
        if (own && w->chosen[PM_LOGGER_FRICTION] != WAVY_FRICTION) {
            first = n == 0 ? &v->column[place->mate] : first;
            n += (size_t)snprintf(x + n, size - n, "%s%s%.40s^2", n == 0 ? "sqrt(" : " + ", of,
                                  v->column[place->mate].name);
        }
    }
    if (first == y && strchr(x, '+') == NULL) {
        snprintf(x, size, "%s%.40s", of, y->name);
    } else if (n < size) {
        const double rest = DRY * first->deviation;
        snprintf(x + n, size - n, " + %.4g)", rest * rest);
    }
    return first;
}

// Writes the dependence of a friction on the temperature of what it heats, T of `of`.
static void write_thermal(pm_logger_writer *w, const char *name, const char *of,
                          const pm_logger_column *T) {
    fprintf(w->model, "*exp(%s*(%s%s - %.6g)/%.4g)*%sdE.%s",
            logarithm(w, "thermal", name, MOST_THERMAL), of, T->name, T->mean, T->deviation, of,
            T->name);
}

void pm_logger_write_friction(pm_logger_writer *w, int c, const char *of, int t, const char *to) {
    char x[4 * PM_LOGGER_TEXT] = "", name[PM_LOGGER_TEXT];
    const pm_logger_column *y = write_speed(w, c, of, x, sizeof x);
    const double start = fmax(y->inertia * y->decay, SMALL * y->inertia * w->v->fastest * SMALL);
    snprintf(name, sizeof name, "%.40s%s%.40s", y->name, t < 0 ? "" : "_to_",
             t < 0 ? "" : w->v->column[t].name);
    fprintf(w->model, "[%s%s, %s%s, \"", of, w->v->column[c].name, to,
            t < 0 ? "s" : w->v->column[t].name);
    // If part of the friction heats a thermometer, that part has the law that regressions show. The
    // friction whose heat goes to the surroundings is then taken as linear.
    pm_logger_column law = *y;
    for (int k = 0; k < w->v->nvariable && t < 0; ++k) {
        law.damped = law.damped && !w->v->warms[c][k];
    }
    pm_logger_write_resistance(w, name, x, &law, NULL, start, NULL);
    if (y->mate >= 0 && w->v->turns[c] && !shares_inertia(w, c) && t < 0) {
        fputs("*exp(0", w->model);
        write_lever(w, name, of, y->part, true, y->mate, 0);
        fputs(")", w->model);
    } else if (t < 0 && shares_inertia(w, c)) { // what turns rubs the more, the longer it is
        fputs("*exp(0", w->model);
        for (int q = 0; q < w->v->nvariable; ++q) {
            if (q != y->mate && !w->v->column[q].angle) {
                write_lever(w, name, of, y->part, true, q, 0);
            }
        }
        fputs(")", w->model);
    }
    if (t >= 0) {
        write_thermal(w, name, to, &w->v->column[t]);
    } else {
        fprintf(w->model, "*%sdE.s", to);
    }
    fputs("\"]", w->model);
}

void pm_logger_write_rubbing(pm_logger_writer *w, int i, int j, const char *one, const char *two) {
    const pm_logger_view *v = w->v;
    const pm_logger_column *y = &v->column[i], *other = &v->column[j];
    const int t = pm_logger_heated(v, i, j);
    const double lever = pm_logger_is_geared(v, i, j) ? fabs(v->lever[y->mate][other->mate]) : 1;
    const double start = fmax(y->inertia * fabs(v->coupling[i][j]) / lever,
                              SMALL * SMALL * y->inertia * v->fastest / (lever * lever));
    const char *of = t >= 0 && v->column[t].part == y->part ? one : two;
    char both[PM_LOGGER_TEXT], x[PM_LOGGER_LONG_TEXT];
    char first[PM_LOGGER_LONG_TEXT] = "1", second[PM_LOGGER_TEXT] = "-1";
    const bool geared = pm_logger_is_geared(v, i, j);
    snprintf(both, sizeof both, "%.40s_%.40s", y->name, other->name);
    snprintf(x, sizeof x, "%s%.40s - %s%.40s", one, y->name, two, other->name);
    if (geared) {
        char factor[PM_LOGGER_TEXT];
        const double fast = v->column[y->mate].ratio, slow = v->column[other->mate].ratio;
        snprintf(first, sizeof first, "%.6g*%s", fast, lever_of(w, factor, y->mate, other->mate));
        snprintf(second, sizeof second, "%.6g", -slow);
        snprintf(x, sizeof x, "%s*%s%.40s - %.6g*%s%.40s", first, one, y->name, slow, two,
                 other->name);
    }
    if (t < 0 && !geared) {
        fprintf(w->model, "[%s%s, %s%s, \"", one, y->name, two, other->name);
    } else {
        fprintf(w->model, "[{\"%s%s\": \"%s\", \"%s%s\": %s}, ", one, y->name, first, two,
                other->name, second);
        if (t >= 0) {
            fprintf(w->model, "%s%s, \"", of, v->column[t].name);
        } else {
            fputs("b.s, \"", w->model);
        }
    }
    pm_logger_write_resistance(w, both, x, geared ? other : y, geared ? y : other, start, NULL);
    if (t >= 0) {
        write_thermal(w, both, of, &v->column[t]);
    } else if (geared) {
        fputs("*b.dE.s", w->model);
    }
    fputs("\"]", w->model);
}

void pm_logger_write_tide(pm_logger_writer *w, const pm_logger_tide *tide, const char *spin,
                          const char *orbit, const char *heat) {
    const pm_logger_column *c = w->v->column;
    const pm_logger_column *s = &c[tide->spin], *x = &c[tide->first], *y = &c[tide->second];
    const char *u = c[x->mate].name, *v = c[y->mate].name;
    char T[PM_LOGGER_TEXT] = "s"; // of the surroundings
    if (tide->heat >= 0 || s->part != x->part) {
        snprintf(T, sizeof T, "%s%.80s", tide->heat >= 0 ? "" : "s_",
                 tide->heat >= 0 ? c[tide->heat].name : s->name);
    }
    const double d = hypot(fmax(fabs(x->least), x->largest), fmax(fabs(y->least), y->largest));
    char square[PM_LOGGER_LONG_TEXT], name[PM_LOGGER_TEXT];
    snprintf(square, sizeof square, "(%s%.40s^2 + %s%.40s^2 + %.4g)", orbit, x->name, orbit,
             y->name, EMPTY * EMPTY * d * d);
    snprintf(name, sizeof name, "%.40s_%.40s", s->name, x->name);
    for (int k = 0; k < 2; ++k) {
        const char *const kind[] = {"tide", "rise"}, *const power[] = {"fall", "drop"};
        const pm_logger_column *slowed = k == 0 ? s : &c[x->mate];
        pm_logger_constant(w, kind[k], name, slowed->inertia * w->v->fastest * SMALL * SMALL,
                           PM_LOGGER_OPTIONAL);
        const char *falls = bounded_place(w, power[k], name, 1, 0, STEEPEST);
        if (k == 0) {
            fprintf(w->model, "[{\"%s%s\": \"-%s%s/%s\", \"%s%s\": \"%s%s/%s\", \"%s%s\": -1}",
                    orbit, u, orbit, y->name, square, orbit, v, orbit, x->name, square, spin,
                    s->name);
        } else {
            fprintf(w->model, ", [{\"%s%s\": \"%s%s/sqrt(%s)\", \"%s%s\": \"%s%s/sqrt(%s)\"}",
                    orbit, u, orbit, x->name, square, orbit, v, orbit, y->name, square);
        }
        fprintf(w->model, ", %s%s, \"%s_%s*exp(-%s*ln(%s/%.4g))*%sdE.%s\"]", heat, T, kind[k], name,
                falls, square, d * d, heat, T);
    }
}

static bool shows_no_length(const pm_logger_column *h) {
    const pm_unit length = pm_unit_parse("m");
    return h->source != NULL && !h->feeds && !pm_unit_equal(&h->dimension, &length);
}

// Returns the law by which fluid spills over the brim of a level, or "0" if it has none. A brim
// that no fluid reaches would never be found.
const char *pm_logger_spill(pm_logger_writer *w, char *text, size_t size,
                            const pm_logger_column *h) {
    snprintf(text, size, "0");
    if (h->spills) {
        const double edge = SMALL * h->deviation;
        const char *brim = bounded_place(w, "brim", h->name, h->mean + h->deviation, h->mean,
                                         h->mean + BRIM * h->deviation);
        snprintf(text, size, "spill_%s*(a.%s - %s + sqrt((a.%s - %s)^2 + %.4g))", h->name, h->name,
                 brim, h->name, brim, edge * edge);
    }
    return text;
}

// Returns the mean of the flows into a level, if one of the levels above is hidden, at most `most`
// of them; else 0.
static double mean_inflow(const pm_logger_view *v, int h, int most) {
    double sum = 0;
    bool hides = v->column[h].source == NULL;
    for (int a = 0; a < v->naction; ++a) {
        const pm_logger_action *action = &v->action[a];
        sum += action->target == h ? action->gain * v->column[action->input].mean : 0;
    }
    for (int above = 0; above < v->nvariable && most > 0; ++above) {
        const double fall = v->falls[above][h] ? mean_inflow(v, above, most - 1) : 0;
        hides = hides || fall > 0;
        sum += fall;
    }
    return hides ? fmax(sum, 0) : 0;
}

const char *pm_logger_flow(pm_logger_writer *w, char *text, size_t size, char end,
                           const pm_logger_column *h) {
    // At its mean the derivative of the flow by the level is that of the regression. Where a hidden
    // level plays a part, regressions tell less than that as much flows out as in.
    const double part = pow(fmax(h->mean / h->largest, SMALL), ROOT);
    const double inflow = mean_inflow(w->v, (int)(h - w->v->column), w->v->nvariable);
    const double outflow =
        inflow > 0 ? inflow / part : h->inertia * fabs(h->decay) * h->mean / (ROOT * part);
    if (!has_constant(w, "outflow", h->name)) {
        pm_logger_constant(w, "outflow", h->name, fmax(outflow, 0), PM_LOGGER_SHARED);
        pm_logger_constant(w, "power", h->name, ROOT / 2, PM_LOGGER_SHARED);
        if (shows_no_length(h)) {
            fprintf(w->list, "      zero_%s: {learned: 0}\n", h->name);
        }
        if (h->spills) {
            pm_logger_constant(w, "spill", h->name, SMALL * h->inertia * w->v->fastest,
                               PM_LOGGER_OPTIONAL);
            pm_logger_constant(w, "caught", h->name, 1, "");
        }
    }
    // A sensor that shows no length may have another zero.
    char zero[PM_LOGGER_TEXT] = "";
    if (shows_no_length(h)) {
        snprintf(zero, sizeof zero, " - zero_%s", h->name);
    }
    snprintf(text, size, "outflow_%s*exp(power_%s*ln(((%c.%s%s)/%.4g)^2 + %.4g))", h->name, h->name,
             end, h->name, zero, h->largest, EMPTY * EMPTY);
    return text;
}

void pm_logger_write_gate(pm_logger_writer *w, int level, int input, bool loses) {
    const pm_logger_view *v = w->v;
    const pm_logger_column *h = &v->column[level], *u = &v->column[input];
    char flow[PM_LOGGER_LONG_TEXT], name[PM_LOGGER_TEXT];
    const double rest = EMPTY * EMPTY * h->largest * h->largest;
    bool some = false;
    snprintf(name, sizeof name, "%.40s_%.40s", u->name, h->name);
    (void)pm_logger_flow(w, flow, sizeof flow, 'a', h);
    for (int j = 0; j < v->nvariable && !loses; ++j) {
        if (v->falls[level][j] && v->column[j].part == h->part) {
            fprintf(w->model, "%s[a.%s, b.z, \"%s/%.6g", some ? ", " : "", v->column[j].name, flow,
                    fabs(u->largest));
            write_opening(w, name, u);
            fprintf(w->model, "/%.4g\"]", pm_logger_highest(v));
            some = true;
        }
    }
    if (loses) {
        fprintf(w->model, "[a.%s, b.s, \"%s/%.6g", h->name, flow, fabs(u->largest));
        write_opening(w, name, u);
        fprintf(w->model, "/sqrt(a.%s^2 + %.4g)*b.dE.s\"]", h->name, rest);
    }
}
