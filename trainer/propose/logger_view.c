// Units and regressions of a logger's columns.
#include "propose/logger_view.h"

#include <ctype.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/hold.h"
#include "propose/logger_reactions.h"
#include "propose/logger_terms.h"

#define SAME 0.05       // of a rate: a velocity differs by less from that of its position
#define FIRST_ORDER 0.3 // of the changes: a length that leaves less unexplained is a level
#define ACTS 1e-3       // of the changes: an input that explains less does not act
#define HELD 0.2        // of the stiffness of a position: a spring to what does not move has more
#define BESIDE 0.1      // of the best target's: other targets have such a share, at least
#define MOVES 1e-3      // of the changes: a part that explains less does not move another one
#define COUPLED 1e-3    // of the changes that one co-energy explains of another one's
#define FAINT 1e-4      // likewise, if it is more than this part of what all leave unexplained:
#define NOTABLE 0.2
#define ALIKE 0.3  // of two coefficients: they are opposite if their sum is smaller
#define LEAK 0.05  // of the decay of a temperature: smaller leaks are none
#define SLOWER 5   // times slower, at first, is the second of two hidden forces, and weaker
#define SOFTER 0.5 // by this factor
#define SLOW 0.1   // of the rate of a column: what is hidden is no slower, at first
#define FRICTION_SHOWS 0.99 // of what else leaves unexplained of the changes of a temperature
#define CLEAR 8.0           // times its noise: a column changes clearly
#define ANSWERED 0.5        // of changes in slope where an input jumps: it drives this co-energy
#define SHARE 8             // part of a trajectory beyond which nothing is sought
#define JUMPS 0.2           // of the changes: a column jumps with an input that explains so much
#define FEWEST_AT_TOP 5     // steps in which a sensor that saturates stays at its largest value
#define SELDOM_EQUAL 0.05
#define NOTHING_ELSE 0.9 // of the deviation of a column: its noise, if it shows nothing else
#define EQUAL 1e-4       // relative difference of steps that count as equal
#define LEFT_OUT -2      // in place of a base
#define ROOM 293.15      // K

static bool has_unit(const pm_logger_column *c, const char *unit) {
    const pm_unit other = pm_unit_parse(unit);
    return c->dimension.known && memcmp(c->dimension.power, other.power, sizeof other.power) == 0;
}

// --- columns ---

// Returns the text of the SI unit of a quantity that is measured in the unit `text`.
static const char *si_unit(pm_logger_view *view, const char *text, const pm_unit *unit) {
    pm_unit si = *unit;
    char name[PM_UNIT_NAME];
    si.factor = 1;
    si.offset = 0;
    if (!unit->known || *text == '\0') {
        return "1";
    }
    if (unit->factor == 1 && unit->offset == 0) {
        return text;
    }
    if (!pm_unit_name(&si, name)) {
        return "1";
    }
    const bool angle = unit->angle && *name == '1';
    return pm_arena_printf(&view->arena, "%s%s", angle ? "rad" : "", name + angle);
}

// --- what columns are ---

// Returns the number of samples m for which column c changes by clearly more than its noise between
// the samples k - m and k + m.
static int find_reach(const pm_logger_samples *w, int c) {
    const pm_dataset *d = w->view->dataset;
    const double noise = w->view->column[c].noise;
    int m = 1;
    for (; m < d->ntime / SHARE; ++m) {
        double square = 0;
        int count = 0;
        for (int i = 0; i < d->ntrajectory; ++i) {
            for (int k = m; k + m < d->ntime; k += m) {
                const double step = pm_logger_row(w, i, k + m)[c] - pm_logger_row(w, i, k - m)[c];
                square += isfinite(step) ? step * step : 0;
                count += isfinite(step);
            }
        }
        if (square > CLEAR * CLEAR * noise * noise * count) {
            break;
        }
    }
    return m;
}

// Adds a hidden variable behind column p, with its rate by differences as a first estimate.
static int add_hidden(pm_logger_samples *w, int p, const char *suffix, const char *unit,
                      pm_logger_kind kind) {
    pm_logger_view *view = w->view;
    const pm_dataset *d = view->dataset;
    const int c = view->nvariable, reach = find_reach(w, p);
    // Inputs stand behind the variables.
    memmove(&view->column[c + 1], &view->column[c],
            (size_t)(view->ncolumn - c) * sizeof *view->column);
    for (int k = 0; k < w->nrow; ++k) {
        double *row = w->value + (ptrdiff_t)k * PM_LOGGER_COLUMNS;
        memmove(row + c + 1, row + c, (size_t)(view->ncolumn - c) * sizeof *row);
    }
    ++view->ncolumn;
    ++view->nvariable;
    view->column[c] = (pm_logger_column){
        .name = pm_arena_printf(&view->arena, "%s_%s", view->column[p].name, suffix),
        .id = -1,
        .base = -1,
        .unit = unit,
        .dimension = pm_unit_parse(unit),
        .kind = kind,
        .mate = -1,
        .behind = p,
        .inertia = 1};
    view->hides = true;
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0; k < d->ntime; ++k) {
            const bool inside = k >= reach && k + reach < d->ntime;
            pm_logger_row(w, i, k)[c] =
                inside ? (pm_logger_row(w, i, k + reach)[p] - pm_logger_row(w, i, k - reach)[p]) /
                             (pm_logger_time(w, i, k + reach) - pm_logger_time(w, i, k - reach))
                       : NAN;
        }
    }
    (void)pm_logger_measure(w, c);
    w->length = 0;
    return c;
}

// Replaces the first estimate x of a hidden column, the rate of y, by (x + b y)/scale.
static void mix(pm_logger_samples *w, int hidden, double b, double scale) {
    const int y = w->view->column[hidden].behind;
    for (int k = 0; k < w->nrow; ++k) {
        double *row = w->value + (ptrdiff_t)k * PM_LOGGER_COLUMNS;
        row[hidden] = (row[hidden] + b * row[y]) / scale;
    }
    (void)pm_logger_measure(w, hidden);
    w->length = 0;
}

// Adds a hidden force that moves velocity y: what all columns leave unexplained of its rate is the
// first estimate. With `slower` it adds a second one, whose samples are 0, so that no regression
// sees it.
static void add_force(pm_logger_samples *w, int y, bool slower) {
    pm_logger_view *view = w->view;
    bool used[PM_LOGGER_COLUMNS];
    double coefficient[1 + PM_LOGGER_COLUMNS];
    for (int j = 0; j < view->ncolumn; ++j) {
        used[j] = true;
    }
    (void)pm_logger_regress(w, y, used, coefficient);
    const pm_unit watt = pm_unit_parse("W");
    const pm_unit unit = pm_unit_quotient(&watt, &view->column[y].dimension);
    const char *symbol = view->column[y].dimension.known ? pm_unit_symbol(&unit) : NULL;
    const int x = add_hidden(w, y, "behind", symbol != NULL ? symbol : "1", PM_LOGGER_FLOW);
    for (int k = 0; k < w->nrow; ++k) {
        double *row = w->value + (ptrdiff_t)k * PM_LOGGER_COLUMNS;
        row[x] -= coefficient[0];
        for (int j = 0; j < view->ncolumn; ++j) {
            const pm_logger_column *other = &view->column[j];
            const int from = j < x ? j : j - 1; // inputs stood one column before
            row[x] -= j == x || !(other->deviation > 0)
                          ? 0
                          : coefficient[1 + from] * (row[j] - other->mean) / other->deviation;
        }
    }
    (void)pm_logger_measure(w, x);
    w->length = 0;
    const int second =
        slower ? add_hidden(w, y, "slower", view->column[x].unit, PM_LOGGER_FLOW) : -1;
    for (int k = 0; k < w->nrow && slower; ++k) {
        w->value[(ptrdiff_t)k * PM_LOGGER_COLUMNS + second] = 0;
    }
    if (slower) {
        view->column[second].twin = x;
        (void)pm_logger_measure(w, second);
    }
}

// Adds the hidden variable of a guess. A linear regression gives y'' + c1 y' + c0 y = ... The rates
// at which the two variables relax are the roots p of p^2 - c1 p + c0 = 0, or their mean if they
// are complex.
static void add_guess(pm_logger_samples *w, int y, pm_logger_guess guess) {
    pm_logger_view *view = w->view;
    pm_logger_column *column = &view->column[y];
    bool used[PM_LOGGER_COLUMNS];
    double coefficient[1 + PM_LOGGER_COLUMNS];
    if (guess == PM_LOGGER_RATE) {
        const pm_unit unit = pm_unit_parse(column->unit);
        column->kind = PM_LOGGER_POSITION;
        column->ratio = 1;
        column->mate =
            add_hidden(w, y, "rate",
                       unit.known && *column->unit != '\0' && strcmp(column->unit, "1") != 0
                           ? pm_arena_printf(&view->arena, "%s/s", column->unit)
                           : "1/s",
                       PM_LOGGER_FLOW);
        view->column[column->mate].mate = y;
        view->column[column->mate].behind = -1;
        return;
    }
    if (guess == PM_LOGGER_MOVED && view->ncolumn > view->nvariable) {
        add_force(w, y, false);
        return;
    }
    const char *unit = guess == PM_LOGGER_MOVED ? "1" : column->unit;
    const bool fed = guess == PM_LOGGER_FED || guess == PM_LOGGER_SPILLED;
    column->kind = fed                        ? PM_LOGGER_LEVEL
                   : guess == PM_LOGGER_MOVED ? PM_LOGGER_FLOW
                                              : PM_LOGGER_TEMPERATURE;
    const int x = add_hidden(w, y, "behind", unit, column->kind);
    view->column[x].spills = guess == PM_LOGGER_SPILLED;
    for (int j = 0; j < view->ncolumn; ++j) {
        used[j] = true;
    }
    (void)pm_logger_regress(w, x, used, coefficient);
    const double c1 = -coefficient[1 + x] / fmax(view->column[x].deviation, DBL_MIN);
    const double c0 = -coefficient[1 + y] / fmax(view->column[y].deviation, DBL_MIN);
    const double root = sqrt(fmax(c1 * c1 / 4 - c0, 0));
    const double rate = view->column[x].deviation / fmax(view->column[y].deviation, DBL_MIN);
    const double slow = fmax(c1 / 2 - root, SLOW * rate), fast = fmax(c1 / 2 + root, rate);
    if (fed) { // y' = slow (x - y)
        mix(w, x, slow, slow);
    } else if (guess == PM_LOGGER_BESIDE) { // y' = fast (x - y)
        mix(w, x, fast, fast);
    }
}

// Regresses the changes of column y from sample to sample on the column, on input u, and, if
// `jumps`, on the changes of u, whose coefficient is returned in *jump. Returns the unexplained
// part.
static double regress_jumps(const pm_logger_samples *w, int y, int u, bool jumps, double *jump) {
    const pm_dataset *d = w->view->dataset;
    double solution[4] = {0};
    pm_least_squares *s = w->squares;
    memset(s, 0, sizeof *s);
    s->n = jumps ? 4 : 3;
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0; k + 1 < d->ntime; ++k) {
            const double *now = pm_logger_row(w, i, k), *next = pm_logger_row(w, i, k + 1);
            const double x[] = {1, now[u] - w->view->column[u].mean,
                                now[y] - w->view->column[y].mean, next[u] - now[u]};
            if (isfinite(next[y] - now[y]) && isfinite(x[3])) {
                pm_least_squares_add(s, x, next[y] - now[y]);
            }
        }
    }
    const double rest = pm_least_squares_solve(s, solution);
    *jump = jumps ? solution[3] : 0;
    return rest;
}

// Makes column y the voltage of a cell with a hidden charge. V, the column without its jumps,
// follows J, the integral of the input, with a slope that the changes within trajectories show. The
// charge is therefore (V(0) - mean)/slope + J. Adds `pairs` variables that relax. They begin with
// half of the resistance, and with times between that of a step and that of a trajectory.
static void add_cell(pm_logger_samples *w, int y, int u, double jump, int pairs) {
    pm_logger_view *view = w->view;
    const pm_dataset *d = view->dataset;
    pm_logger_column *column = &view->column[y];
    const double sign = jump < 0 ? -1 : 1;
    double product = 0, square = 0, length = 0;
    for (int k = 0; k < w->nrow; ++k) {
        double *row = w->value + (ptrdiff_t)k * PM_LOGGER_COLUMNS;
        row[y] -= jump * row[u];
    }
    (void)pm_logger_measure(w, y);
    for (int pass = 0; pass < 2; ++pass) { // the slope, then the charges
        const double slope = product > 0 && square > 0 ? product / square : column->slope;
        column->slope = slope;
        for (int i = 0; i < d->ntrajectory; ++i) {
            double charge = 0, sum[4] = {0}, first = NAN;
            int count = 0;
            for (int k = 0; k < d->ntime && isfinite(pm_logger_time(w, i, k)); ++k) {
                double *row = pm_logger_row(w, i, k);
                const double value = row[y];
                if (k > 0) {
                    const double before = pm_logger_row(w, i, k - 1)[u];
                    const double step = pm_logger_time(w, i, k) - pm_logger_time(w, i, k - 1);
                    charge += isfinite(before) ? sign * before * step : 0;
                    length = fmax(length, pm_logger_time(w, i, k) - pm_logger_time(w, i, 0));
                }
                first = isfinite(first) ? first : value;
                if (pass == 1) {
                    row[y] = (first - column->voltage) / slope + charge;
                } else if (isfinite(value)) {
                    sum[0] += charge, sum[1] += value;
                    sum[2] += charge * charge, sum[3] += charge * value;
                    ++count;
                }
            }
            if (pass == 0 && count > 0) {
                square += sum[2] - sum[0] * sum[0] / count;
                product += sum[3] - sum[0] * sum[1] / count;
            }
        }
        if (pass == 0) {
            column->voltage = column->mean;
            column->slope = column->deviation / fmax(sqrt(square / w->nrow), DBL_MIN);
        }
    }
    const char *name = column->name, *unit = column->unit;
    const int part = column->part;
    column->seen = column->source;
    column->source = NULL;
    column->name = pm_arena_printf(&view->arena, "%s_charge", name);
    column->unit = pm_arena_printf(&view->arena, "%s s", view->column[u].unit);
    column->kind = PM_LOGGER_CHARGE;
    column->dimension = pm_unit_parse(column->unit);
    column->current = view->column[u].id;
    column->resistance = jump;
    (void)pm_logger_measure(w, y);
    view->hides = true;
    for (int k = 0; k < pairs; ++k) {
        char suffix[] = "pair1";
        suffix[strlen(suffix) - 1] = (char)('1' + k);
        const int x = add_hidden(w, y, suffix, unit, PM_LOGGER_FLOW);
        pm_logger_column *pair = &view->column[x];
        pair->name = pm_arena_printf(&view->arena, "%s_%s", name, suffix);
        pair->part = part;
        pair->relaxes = d->dt * pow(length / d->dt, (1 + k) / (2.0 + pairs));
        pair->current = column->current;
        // The voltage that the current leaves in the pair.
        double spread = 0;
        for (int v = view->nvariable; v < view->ncolumn; ++v) {
            spread = view->column[v].id == column->current
                         ? hypot(view->column[v].deviation, view->column[v].mean)
                         : spread;
        }
        pair->resistance = fabs(jump) / 2;
        pair->inertia = pair->relaxes / pair->resistance;
        for (int i = 0; i < w->nrow; ++i) {
            w->value[(ptrdiff_t)i * PM_LOGGER_COLUMNS + x] = 0;
        }
        pair->deviation = pair->resistance * spread;
        pair->mean = 0;
        pair->least = -pair->deviation;
        pair->largest = pair->deviation;
    }
    w->length = 0;
}

static bool is_displacement(const pm_logger_column *c) {
    return c->angle || has_unit(c, "m") || has_unit(c, "C") || has_unit(c, "m^3");
}

static bool is_flow(const pm_logger_column *c) {
    return has_unit(c, "m/s") || has_unit(c, "rad/s") || has_unit(c, "A") || has_unit(c, "m^3/s");
}

// Returns the size of a ratio, or 1 with its sign if it is close to that.
static double round_ratio(double ratio, double tolerance) {
    return fabs(fabs(ratio) - 1) < tolerance ? copysign(1, ratio) : ratio;
}

// Marks the inputs that may be a part of the rate of column q, as a flow into a volume is.
static void use_flows(const pm_logger_view *view, int q, bool *used) {
    const pm_unit second = pm_unit_parse("s");
    for (int u = view->nvariable; u < view->ncolumn; ++u) {
        const pm_unit unit = pm_unit_product(&view->column[u].dimension, &second);
        used[u] = view->column[q].dimension.known && view->column[u].dimension.known &&
                  is_displacement(&view->column[q]) &&
                  pm_unit_equal(&view->column[q].dimension, &unit);
    }
}

// Makes column q a position if velocities explain its rate. The length of a spring between two
// bodies has several such velocities, and a load behind a gear has one. The mate of q is the
// velocity that moves it most, among those of its part that have no mate yet.
static void find_length(pm_logger_samples *w, int q) {
    pm_logger_view *view = w->view;
    const pm_unit second = pm_unit_parse("s");
    bool used[PM_LOGGER_COLUMNS] = {false};
    double coefficient[1 + PM_LOGGER_COLUMNS], most = 0, own = 0;
    int count = 0, mate = -1;
    for (int v = 0; v < view->nvariable; ++v) {
        const pm_unit unit = pm_unit_product(&view->column[v].dimension, &second);
        used[v] = is_flow(&view->column[v]) && pm_unit_equal(&view->column[q].dimension, &unit);
        count += used[v];
    }
    use_flows(view, q, used);
    if (view->column[q].mate >= 0 || !is_displacement(&view->column[q]) || count == 0 ||
        !(pm_logger_regress(w, q, used, coefficient) < 2 * SAME)) {
        return;
    }
    for (int v = 0; v < view->nvariable; ++v) {
        const double size = used[v] ? fabs(coefficient[1 + v]) : 0;
        most = fmax(most, size);
        if (size > own && view->column[v].mate < 0 &&
            view->column[v].part == view->column[q].part) {
            own = size, mate = v;
        }
    }
    for (int v = 0; v < view->nvariable && mate >= 0; ++v) {
        if (used[v] && fabs(coefficient[1 + v]) > SAME * most) {
            const double ratio =
                round_ratio(coefficient[1 + v] / view->column[v].deviation, 2 * SAME);
            *(v == mate ? &view->column[q].ratio : &view->moves[q][v]) = ratio;
        }
    }
    if (mate >= 0) {
        view->column[q].mate = mate;
        view->column[q].kind = PM_LOGGER_POSITION;
        view->column[mate].mate = q;
    }
}

// Finds which inputs fill positions: beside the velocities they explain the rate with the factor 1.
static void find_flows(pm_logger_samples *w) {
    pm_logger_view *view = w->view;
    for (int q = 0; q < view->nvariable; ++q) {
        const pm_logger_column *place = &view->column[q];
        bool used[PM_LOGGER_COLUMNS] = {false};
        double coefficient[1 + PM_LOGGER_COLUMNS];
        if (place->kind != PM_LOGGER_POSITION || place->guided || place->source == NULL ||
            view->column[place->mate].source == NULL) {
            continue;
        }
        use_flows(view, q, used);
        for (int v = 0; v < view->nvariable; ++v) {
            used[v] = v == place->mate || view->moves[q][v] != 0;
        }
        (void)pm_logger_regress(w, q, used, coefficient);
        for (int u = view->nvariable; u < view->ncolumn && view->naction < PM_LOGGER_ACTIONS; ++u) {
            const double slope = used[u] && view->column[u].deviation > 0
                                     ? coefficient[1 + u] / view->column[u].deviation
                                     : 0;
            if (fabs(fabs(slope) - 1) < 2 * SAME) {
                view->action[view->naction++] = (pm_logger_action){
                    .input = u, .target = q, .effect = PM_LOGGER_FILLS, .gain = copysign(1, slope)};
            }
        }
    }
}

// Finds positions with their velocities, then gives each variable its kind.
static pm_status find_kinds(pm_logger_samples *w, const pm_logger_hints *hints) {
    pm_logger_view *view = w->view;
    const pm_unit second = pm_unit_parse("s");
    bool fluid = false;
    for (int c = 0; c < view->ncolumn; ++c) {
        fluid = fluid || has_unit(&view->column[c], "m^3/s");
    }
    w->length = 0;
    // The best pairs first, and those of one part before all others.
    bool apart = false;
    for (int pairs = 0; pairs < 2 * view->nvariable; ++pairs) {
        int q = -1, v = -1;
        double best = INFINITY, ratio = 1;
        for (int i = 0; i < view->nvariable; ++i) {
            for (int j = 0; j < view->nvariable; ++j) {
                const pm_logger_column *a = &view->column[i], *b = &view->column[j];
                const pm_unit unit = pm_unit_product(&b->dimension, &second);
                const bool known = a->dimension.known && b->dimension.known;
                const bool same = !known || pm_unit_equal(&a->dimension, &unit);
                // A rack, a piston, or another sign. What a volume flow fills is a level.
                const bool level = has_unit(a, "m") && has_unit(b, "m^3/s");
                const bool geared = known && is_displacement(a) && is_flow(b) && !level;
                bool used[PM_LOGGER_COLUMNS] = {false};
                double coefficient[1 + PM_LOGGER_COLUMNS];
                if (i == j || a->mate >= 0 || b->mate >= 0 || !(same || geared) ||
                    (!apart && a->part != b->part)) {
                    continue;
                }
                used[j] = true;
                use_flows(view, i, used);
                const double rest = pm_logger_regress(w, i, used, coefficient);
                const double slope = coefficient[1 + j] / (b->deviation > 0 ? b->deviation : 1);
                const double own = same ? round_ratio(slope, SAME) : slope;
                if (rest < fmin(best, 2 * SAME) && (own == 1 || (geared && (own == -1 || !same)))) {
                    best = rest, q = i, v = j, ratio = own;
                }
            }
        }
        if (q < 0 && apart) {
            break;
        }
        if (q < 0) {
            apart = true;
            continue;
        }
        view->column[q].ratio = ratio;
        view->column[q].mate = v;
        view->column[q].kind = PM_LOGGER_POSITION;
        view->column[v].mate = q;
    }
    for (int q = 0; q < view->nvariable; ++q) {
        find_length(w, q);
    }
    find_flows(w);
    PM_TRY(pm_logger_find_guides(w, false));
    const int measured = view->nvariable;
    for (int c = 0; c < measured; ++c) {
        pm_logger_column *column = &view->column[c];
        pm_logger_guess guess =
            hints->guess == NULL ? PM_LOGGER_AS_FOUND : hints->guess[column->id];
        bool used[PM_LOGGER_COLUMNS];
        for (int j = 0; j < view->ncolumn; ++j) {
            used[j] = true;
        }
        if (column->mate >= 0) {
            column->guess = guess;
            const int hides = pm_logger_hides(guess);
            if (hides > 0 && view->ncolumn + hides <= PM_LOGGER_COLUMNS) {
                add_force(w, c, hides > 1);
            }
            continue;
        }
        // A tank holds no less than nothing; a head of a fluid may change its sign.
        const bool length = has_unit(column, "m");
        const bool tank = length && column->least > -CLEAR * column->noise;
        if (has_unit(column, "mol") || has_unit(column, "mol/m^3")) {
            column->kind = PM_LOGGER_AMOUNT;
            column->guess = PM_LOGGER_COMPLETE;
            continue;
        }
        // The input with which the column jumps, as a voltage does with a current.
        double most = JUMPS, jump = 0;
        int current = -1;
        for (int u = view->nvariable; u < view->ncolumn; ++u) {
            const pm_unit product = pm_unit_product(&column->dimension, &view->column[u].dimension);
            const pm_unit watt = pm_unit_parse("W");
            if (product.known && !pm_unit_equal(&product, &watt)) {
                continue;
            }
            double own, none;
            const double with = regress_jumps(w, c, u, true, &own);
            const double share = regress_jumps(w, c, u, false, &none) - with;
            if (view->column[u].held && share > most) {
                most = share, jump = own, current = u;
            }
        }
        if (current >= 0 && view->ncolumn + 2 < PM_LOGGER_COLUMNS &&
            (guess == PM_LOGGER_AS_FOUND || guess >= PM_LOGGER_CELL)) {
            column->guess = guess == PM_LOGGER_AS_FOUND ? PM_LOGGER_CELL_1 : guess;
            add_cell(w, c, current, jump, (int)column->guess - PM_LOGGER_CELL);
            continue;
        }
        if (guess == PM_LOGGER_AS_FOUND) {
            const bool level =
                length && (fluid || pm_logger_regress(w, c, used, NULL) < FIRST_ORDER);
            guess = hints->hidden != 0 && (length || column->angle) && !level ? PM_LOGGER_RATE
                                                                              : PM_LOGGER_COMPLETE;
        }
        column->guess = guess;
        column->kind = has_unit(column, "K") ? PM_LOGGER_TEMPERATURE
                       : tank                ? PM_LOGGER_LEVEL
                                             : PM_LOGGER_FLOW;
        if (pm_logger_hides(guess) && view->ncolumn < PM_LOGGER_COLUMNS) {
            add_guess(w, c, guess);
        }
    }
    for (int c = 0; c < measured; ++c) {
        pm_logger_column *column = &view->column[c];
        const bool thermal = has_unit(column, "K");
        const bool rate =
            has_unit(column, "m/s") || has_unit(column, "A") || has_unit(column, "rad/s");
        const bool room = view->ncolumn < PM_LOGGER_COLUMNS;
        const bool may[PM_LOGGER_NGUESS] = {
            [PM_LOGGER_COMPLETE] = true,
            [PM_LOGGER_RATE] = room && !thermal && !rate,
            [PM_LOGGER_FED] = room && !thermal && !rate && !column->angle,
            [PM_LOGGER_SPILLED] = room && !thermal && !rate && !column->angle,
            [PM_LOGGER_MOVED] = room && !thermal && !has_unit(column, "m") && !column->angle,
            [PM_LOGGER_BESIDE] = room && thermal};
        if (column->seen != NULL) { // a cell
            const pm_logger_guess cells[] = {PM_LOGGER_CELL, PM_LOGGER_CELL_2, PM_LOGGER_COMPLETE};
            memcpy(column->other, cells, sizeof cells);
            column->nother = sizeof cells / sizeof *cells;
        }
        const bool alone = column->mate < 0 || view->column[column->mate].source == NULL;
        if (!alone && column->kind == PM_LOGGER_FLOW && column->guess == PM_LOGGER_AS_FOUND) {
            column->other[column->nother++] = PM_LOGGER_MOVED;
            column->other[column->nother++] = PM_LOGGER_MOVED_2;
        }
        for (int g = PM_LOGGER_COMPLETE; g < PM_LOGGER_CELL && column->source != NULL && alone &&
                                         column->kind != PM_LOGGER_AMOUNT;
             ++g) {
            if (may[g] && g != (int)column->guess) {
                column->other[column->nother++] = (pm_logger_guess)g;
            }
        }
    }
    return PM_OK;
}

// --- inputs and scales ---

static bool is_coenergy(const pm_logger_column *c) {
    return c->kind != PM_LOGGER_POSITION && c->kind != PM_LOGGER_CHARGE &&
           c->kind != PM_LOGGER_AMOUNT;
}

static bool is_power(const pm_logger_column *a, const pm_logger_column *b) {
    const pm_unit power = pm_unit_product(&a->dimension, &b->dimension);
    const pm_unit watt = pm_unit_parse("W");
    return pm_unit_equal(&power, &watt);
}

// Returns true if an input has a known power, such as a pressure that drives a flow.
static bool knows_power(const pm_logger_view *view) {
    bool knows = false;
    for (int c = 0; c < view->nvariable; ++c) {
        for (int u = view->nvariable; u < view->ncolumn; ++u) {
            knows = knows || (view->column[c].kind == PM_LOGGER_FLOW &&
                              is_power(&view->column[u], &view->column[c]));
        }
    }
    return knows;
}

// Returns true if an input may flow into the vessel of a level.
static bool may_fill(const pm_logger_column *input, const pm_logger_column *target) {
    return has_unit(target, "m") && has_unit(input, "m^3/s");
}

// Returns how input u may act on variable c, as their units tell: with the factor 1, as heat, or
// as a bath. If the units do not tell, the factor is learned. The power of an inflow is that of a
// level times a constant, which is 1 where nothing else shows the scale of power.
static pm_logger_effect effect_of(const pm_logger_view *view, int u, int c) {
    const pm_logger_column *input = &view->column[u], *target = &view->column[c];
    const pm_unit number = pm_unit_parse("1");
    if (target->kind == PM_LOGGER_TEMPERATURE) {
        return has_unit(input, "W")   ? PM_LOGGER_HEATS
               : has_unit(input, "K") ? PM_LOGGER_BATH
                                      : PM_LOGGER_WARMS;
    }
    return is_power(input, target) || (may_fill(input, target) && !knows_power(view))
               ? PM_LOGGER_DRIVES
           : target->kind == PM_LOGGER_FLOW && input->dimension.known &&
                   pm_unit_equal(&input->dimension, &target->dimension) &&
                   !pm_unit_equal(&input->dimension, &number)
               ? PM_LOGGER_THROUGH
               : PM_LOGGER_GAIN;
}

// Returns true if the product of the units of an input and of co-energy c is a power.
static bool may_drive(const pm_logger_view *view, int u, int c) {
    return is_coenergy(&view->column[c]) && view->column[c].relaxes == 0 &&
           effect_of(view, u, c) == PM_LOGGER_DRIVES;
}

static bool is_learned(pm_logger_effect effect) {
    return effect == PM_LOGGER_GAIN || effect == PM_LOGGER_WARMS;
}

// Returns the co-energy on which an input of known power acts, or -1. Its unit must allow it. A
// co-energy that clearly answers at once where the input jumps comes first, then the one whose
// changes the input explains best. The factor is 1, or -1, as of a load, if none answers with the
// input's sign.
static int driven_by(const pm_logger_view *view, int u) {
    int best = -1, sharpest = -1;
    bool along = false;
    for (int c = 0; c < view->nvariable; ++c) {
        along = along || (may_drive(view, u, c) && view->coupling[c][u] > 0);
    }
    for (int c = 0; c < view->nvariable; ++c) {
        if (may_drive(view, u, c) && (view->coupling[c][u] > 0) == along) {
            best = best < 0 || view->share[c][u] > view->share[best][u] ? c : best;
            sharpest = view->answer[c][u] > ANSWERED &&
                               (sharpest < 0 || view->answer[c][u] > view->answer[sharpest][u])
                           ? c
                           : sharpest;
        }
    }
    return sharpest >= 0 ? sharpest : best;
}

// Finds the variables on which each input acts: those whose changes it explains and, if there are
// any, whose unit allows it. An input drives one variable. Its factor for all others is learned,
// because it may move them through an inertia that they share with the first.
static void find_actions(pm_logger_view *view) {
    for (int c = 0; c < view->nvariable; ++c) {
        const pm_logger_column *cell =
            view->column[c].relaxes > 0 ? &view->column[view->column[c].behind] : &view->column[c];
        for (int u = view->nvariable; u < view->ncolumn && cell->seen != NULL; ++u) {
            if (view->column[u].id == cell->current) {
                view->action[view->naction++] =
                    (pm_logger_action){.input = u,
                                       .target = c,
                                       .effect = PM_LOGGER_FILLS,
                                       .gain = cell->resistance < 0 ? -1 : 1};
            }
        }
    }
    for (int u = view->nvariable; u < view->ncolumn; ++u) {
        bool by_unit = false;
        double best = 0;
        int strongest = -1;
        const int driven = driven_by(view, u);
        for (int pass = 0; pass < 3; ++pass) { // units, the best share, actions
            for (int c = 0; c < view->nvariable; ++c) {
                if (!is_coenergy(&view->column[c]) || view->column[c].relaxes > 0) {
                    continue;
                }
                const pm_logger_effect effect = effect_of(view, u, c);
                const bool told =
                    !is_learned(effect) || may_fill(&view->column[u], &view->column[c]);
                const bool candidate =
                    (!by_unit || told) && (effect != PM_LOGGER_THROUGH || driven < 0);
                const double share = view->share[c][u];
                // A valve between two chambers moves the pressures of both.
                const bool like_best =
                    pass == 2 && strongest >= 0 && is_learned(effect) && view->column[c].mate < 0 &&
                    pm_unit_equal(&view->column[c].dimension, &view->column[strongest].dimension);
                if (pass == 0) {
                    by_unit = by_unit || told;
                } else if (pass == 1 && candidate) {
                    strongest = share > best ? c : strongest;
                    best = fmax(best, share);
                } else if (candidate && view->naction < PM_LOGGER_ACTIONS &&
                           (c == driven || like_best ||
                            (share >= BESIDE * best && (share > ACTS || share == best)))) {
                    const bool beside = (effect == PM_LOGGER_DRIVES && c != driven) ||
                                        (effect == PM_LOGGER_THROUGH && view->coupling[c][u] <= 0);
                    view->action[view->naction++] =
                        (pm_logger_action){.input = u,
                                           .target = c,
                                           .effect = beside ? PM_LOGGER_GAIN : effect,
                                           .gain = view->coupling[c][u] < 0 ? -1 : 1};
                }
            }
        }
    }
    for (int u = view->nvariable; u < view->ncolumn; ++u) {
        const int driven = driven_by(view, u);
        for (int c = 0; c < view->nvariable && view->column[u].guess == PM_LOGGER_FREELY; ++c) {
            bool acts = driven < 0 || view->column[c].kind != PM_LOGGER_FLOW ||
                        view->column[c].part != view->column[driven].part;
            for (int a = 0; a < view->naction; ++a) {
                acts = acts || (view->action[a].input == u && view->action[a].target == c);
            }
            if (!acts && view->naction < PM_LOGGER_ACTIONS) {
                view->action[view->naction++] =
                    (pm_logger_action){.input = u, .target = c, .effect = PM_LOGGER_GAIN};
            }
        }
    }
    // A bath of one temperature of a part is near the others, too: what passes to those that change
    // for many reasons is too little for a regression. The first estimate of a hidden temperature
    // comes from the rate of another one, so that regressions cannot tell which of both it reaches.
    const int found = view->naction;
    for (int a = 0; a < found; ++a) {
        pm_logger_action bath = view->action[a];
        const int part = view->column[bath.target].part;
        bool hides = false;
        for (int h = 0; h < view->nvariable && bath.effect == PM_LOGGER_BATH; ++h) {
            const pm_logger_column *hidden = &view->column[h];
            hides = hides || (hidden->behind >= 0 && hidden->kind == PM_LOGGER_TEMPERATURE &&
                              hidden->part == part);
        }
        for (int c = 0; c < view->nvariable && view->naction < PM_LOGGER_ACTIONS; ++c) {
            bool reached = bath.effect != PM_LOGGER_BATH || view->column[c].part != part ||
                           view->column[c].kind != PM_LOGGER_TEMPERATURE;
            for (int b = 0; b < view->naction; ++b) {
                reached = reached || (view->action[b].target == c &&
                                      (view->action[b].input == bath.input ||
                                       (view->action[b].effect == PM_LOGGER_BATH && !hides)));
            }
            if (!reached) {
                bath.target = c;
                view->action[view->naction++] = bath;
            }
        }
    }
}

// Finds which temperatures tend towards surroundings that no input describes, and how warm these
// are, from the couplings and the constant rates of the view.
static void find_surroundings(pm_logger_view *view) {
    double sum = 0, weight = 0;
    for (int i = 0; i < view->nvariable; ++i) {
        const pm_logger_column *c = &view->column[i];
        double leak = c->decay;
        bool bath = false;
        for (int j = 0; j < view->nvariable; ++j) {
            leak -=
                j != i && view->column[j].kind == PM_LOGGER_TEMPERATURE ? view->coupling[i][j] : 0;
        }
        for (int a = 0; a < view->naction; ++a) {
            bath =
                bath || (view->action[a].effect == PM_LOGGER_BATH && view->action[a].target == i);
        }
        const double outside = leak > 0 ? c->constant / leak : 0;
        view->leaks[i] = c->kind == PM_LOGGER_TEMPERATURE && !bath && leak > LEAK * c->decay &&
                         outside > PM_LOGGER_COLDEST && outside < PM_LOGGER_HOTTEST;
        view->leak[i] = leak;
        sum += view->leaks[i] ? leak * outside : 0;
        weight += view->leaks[i] ? leak : 0;
    }
    view->bath = weight > 0 ? sum / weight : ROOM;
}

// Finds co-energies of one kind that share an inertia: an input drives d and moves o, too. The
// energy is a (i + k j)^2/2 + b j^2/2, i < j. The inverse W of its matrix follows from the answers
// to the input and from the two losses. Returns whether they are found.
static bool find_mutual(pm_logger_view *view, const pm_logger_action *action) {
    const int o = action->target, u = action->input, d = driven_by(view, u);
    if (d < 0 || d == o || view->column[o].mate >= 0 || view->column[d].mate >= 0 ||
        view->column[o].part != view->column[d].part || view->column[o].kind == PM_LOGGER_LEVEL ||
        !pm_unit_equal(&view->column[o].dimension, &view->column[d].dimension)) {
        return false;
    }
    const int i = d < o ? d : o, j = d < o ? o : d;
    const double both = view->coupling[o][u], lost = both * view->coupling[o][o];
    const double own = lost / view->coupling[d][o],
                 W[2] = {i == d ? view->coupling[d][u] : own, j == d ? view->coupling[d][u] : own};
    const double first = W[0] - both * both / W[1];
    const bool found = W[1] > 0 && first > 0 && isfinite(first);
    if (found) {
        view->mutual[i][j] = -both / W[1];
        view->column[i].inertia = 1 / first;
        view->column[j].inertia = 1 / W[1];
    }
    return found;
}

// Returns how velocity v changes position q; 0: not at all.
static double rate_of(const pm_logger_view *view, int q, int v) {
    const pm_logger_column *c = &view->column[q];
    const bool own = c->kind == PM_LOGGER_POSITION && c->mate == v && !c->guided;
    return own ? c->ratio : view->moves[q][v];
}

// Returns true if velocity v moves a position of a part.
static bool moves_part(const pm_logger_view *view, int part, int v) {
    bool some = false;
    for (int q = 0; q < view->nvariable; ++q) {
        some = some || (view->column[q].part == part && rate_of(view, q, v) != 0);
    }
    return some;
}

// Returns how variable j changes i if it does so beside all others, 0 otherwise.
static double response(const pm_logger_view *view, int i, int j) {
    return view->share[i][j] > COUPLED ? view->coupling[i][j] : 0;
}

// Returns how temperature t moves flow i. A faint effect counts if the flow clearly changes the
// temperature, because both effects come from the same entry of L.
static double push(const pm_logger_view *view, int i, int t) {
    return response(view, t, i) != 0 && view->share[i][t] > FAINT ? view->coupling[i][t] : 0;
}

// Multiplies all heat capacities, or all inertias, by a factor that data have shown.
static void scale(pm_logger_view *view, bool heat, double factor) {
    for (int k = 0; k < view->nvariable; ++k) {
        pm_logger_column *y = &view->column[k];
        if ((y->kind == PM_LOGGER_TEMPERATURE) == heat && y->kind != PM_LOGGER_POSITION) {
            y->inertia *= factor;
            y->free_scale = false;
        }
    }
}

// Joins the scales of heat and motion. Temperature t changes flow i by `pushes`, and flow i changes
// temperature t by `cools`. Both come from one entry of L, which fixes the ratio of inertias and
// heat capacities. The scale that nothing has shown yet follows from the other one.
static void join_scales(pm_logger_view *view, int i, int t, double pushes, double cools) {
    const pm_logger_column *T = &view->column[t];
    const double moved = T->inertia * fabs(cools / (T->mean * pushes));
    const double ratio = moved / view->column[i].inertia;
    const bool heat = pm_logger_heat_is_free(view);
    if (view->joined || (!heat && !view->column[i].free_scale)) {
        return;
    }
    view->joined = true;
    scale(view, heat, heat ? 1 / ratio : ratio);
}

// Regresses the changes of temperature t, while flow i changes clearly, on the temperatures, on the
// inputs and, unless `alone`, on what flow i loses of y^2/2, whose coefficient is *heats. Returns
// the unexplained part.
static double regress_heat(const pm_logger_samples *w, int t, int i, bool alone, double *heats) {
    const pm_logger_view *view = w->view;
    const pm_dataset *d = view->dataset;
    const int reach = find_reach(w, i);
    double solution[PM_LOGGER_COLUMNS + 2] = {0};
    pm_least_squares *s = w->squares;
    memset(s, 0, sizeof *s);
    for (int r = 0; r < d->ntrajectory; ++r) {
        for (int k = 0; k + reach < d->ntime; ++k) {
            const double *now = pm_logger_row(w, r, k), *next = pm_logger_row(w, r, k + reach);
            const double dt = pm_logger_time(w, r, k + reach) - pm_logger_time(w, r, k);
            double x[PM_LOGGER_COLUMNS + 2] = {1, (now[i] * now[i] - next[i] * next[i]) / 2 / dt};
            int n = alone ? 1 : 2;
            double sum = next[t] - now[t] + x[1];
            for (int c = 0; c < view->ncolumn; ++c) {
                const pm_logger_column *column = &view->column[c];
                if (c >= view->nvariable || column->kind == PM_LOGGER_TEMPERATURE) {
                    x[n] = now[c] - column->mean;
                    sum += x[n++];
                }
            }
            s->n = n;
            if (isfinite(sum)) {
                pm_least_squares_add(s, x, (next[t] - now[t]) / dt);
            }
        }
    }
    const double rest = pm_least_squares_solve(s, solution);
    *heats = alone ? 0 : solution[1];
    return rest;
}

// Where a heater of known power shows a heat capacity, but no force an inertia, what friction warms
// shows the scale of motion.
static void find_heat_of_friction(pm_logger_samples *w) {
    pm_logger_view *view = w->view;
    double least = FRICTION_SHOWS, ratio = 0;
    bool forced = pm_logger_heat_is_free(view);
    for (int a = 0; a < view->naction; ++a) {
        forced = forced || (view->action[a].effect == PM_LOGGER_DRIVES &&
                            view->column[view->action[a].target].kind == PM_LOGGER_FLOW);
    }
    for (int i = 0; i < view->nvariable; ++i) {
        const pm_logger_column *y = &view->column[i];
        for (int t = 0; t < view->nvariable; ++t) {
            const pm_logger_column *T = &view->column[t];
            double heats;
            if (y->kind != PM_LOGGER_FLOW || y->mate >= 0 || !y->free_scale || y->behind >= 0 ||
                T->kind != PM_LOGGER_TEMPERATURE || T->source == NULL || T->free_scale || forced) {
                continue;
            }
            const double without = regress_heat(w, t, i, true, &heats);
            const double with = regress_heat(w, t, i, false, &heats);
            if (heats > 0 && with < least * without) {
                least = with / without;
                ratio = heats * T->inertia / y->inertia;
            }
        }
    }
    if (ratio > 0) {
        scale(view, false, ratio);
    }
}

// Finds how motion and flows exchange energy with heat. A flow carries entropy if a difference of
// two temperatures drives it and if it cools one and warms the other. A piston between two gases
// does the same, but carries no entropy.
static void find_exchange(pm_logger_view *view) {
    for (int i = 0; i < view->nvariable; ++i) {
        for (int a = 0; a < view->nvariable && view->column[i].kind == PM_LOGGER_FLOW; ++a) {
            for (int b = 0; b < view->nvariable; ++b) {
                const double to = push(view, i, a), from = push(view, i, b);
                const pm_logger_carrier c = {i, a, b, to * view->column[i].inertia};
                const int one = view->column[a].part, own = view->column[i].part;
                const int other = view->column[b].part != one ? view->column[b].part : own;
                if (view->column[a].kind == PM_LOGGER_TEMPERATURE &&
                    view->column[b].kind == PM_LOGGER_TEMPERATURE && to > 0 && from < 0 &&
                    fabs(to + from) < ALIKE * (to - from) && response(view, a, i) < 0 &&
                    response(view, b, i) > 0 && pm_logger_carries(view, &c, one, other) &&
                    pm_logger_meets(view, one, other) &&
                    !(moves_part(view, one, i) && moves_part(view, other, i)) &&
                    view->ncarrier < PM_LOGGER_CARRIERS) {
                    join_scales(view, i, a, to, response(view, a, i));
                    pm_logger_carrier *carrier = &view->carrier[view->ncarrier++];
                    *carrier = c;
                    carrier->entropy = to * view->column[i].inertia;
                    // Entropy times temperature is heat.
                    view->column[b].inertia =
                        carrier->entropy * view->column[b].mean / view->coupling[b][i];
                    view->column[b].free_scale = false;
                }
            }
        }
    }
    // The entropy of a temperature may depend on a position of its part: the temperature changes
    // with the velocity, and the velocity with the temperature.
    for (int q = 0; q < view->nvariable; ++q) {
        const int i = view->column[q].mate;
        for (int t = 0; t < view->nvariable; ++t) {
            pm_logger_column *T = &view->column[t];
            if (view->column[q].kind != PM_LOGGER_POSITION || T->kind != PM_LOGGER_TEMPERATURE ||
                T->part != view->column[q].part || T->source == NULL) {
                continue;
            }
            const double cools = response(view, t, i), pushes = response(view, i, t);
            const bool shown = cools * pushes < 0;
            view->expands[q][t] = shown || T->guess == PM_LOGGER_EXPANDED;
            if (shown) {
                join_scales(view, i, t, pushes, cools);
            }
        }
    }
}

// Chooses the scale of a hidden force, which no data show, such that the force and the co-energy
// that it moves are coupled by one entry of L.
static void scale_force(pm_logger_samples *w, int c) {
    pm_logger_view *view = w->view;
    const int y = view->column[c].behind;
    const double to = view->coupling[y][c] * view->column[y].inertia;
    const double back = view->coupling[c][y] * view->column[c].inertia;
    if (view->column[c].free_scale && view->column[c].kind == PM_LOGGER_FLOW && to * back < 0) {
        mix(w, c, 0, sqrt(-back / to));
        pm_logger_regress_all(w);
    }
}

// Finds the inertia, or capacity, of each co-energy with which a fit begins. It follows from the
// answer to an input of known power, or from a coupling of two co-energies, which must be equal and
// opposite.
static void find_scales(pm_logger_samples *w) {
    pm_logger_view *view = w->view;
    bool known[PM_LOGGER_COLUMNS] = {false};
    // No data show the scale of a hidden variable, unless it is a temperature. Its inertia is
    // therefore the unit. If an input of known power acts on it, the values of the variable are
    // scaled accordingly.
    for (int c = 0; c < view->nvariable; ++c) {
        const bool hidden = view->column[c].behind >= 0;
        view->column[c].free_scale =
            hidden && view->column[c].relaxes == 0 && view->column[c].kind != PM_LOGGER_TEMPERATURE;
        known[c] = view->column[c].free_scale || view->column[c].relaxes > 0;
        for (int a = 0; a < view->naction && view->column[c].free_scale; ++a) {
            const double response = fabs(view->coupling[c][view->action[a].input]);
            if (view->action[a].target == c && view->action[a].effect == PM_LOGGER_DRIVES &&
                response > 0) {
                mix(w, c, 0, response);
                pm_logger_regress_all(w);
            }
        }
    }
    for (int a = 0; a < view->naction; ++a) {
        const pm_logger_action *action = &view->action[a];
        pm_logger_column *c = &view->column[action->target];
        const double response = fabs(view->coupling[action->target][action->input]);
        if (!is_learned(action->effect) && action->effect != PM_LOGGER_BATH &&
            action->effect != PM_LOGGER_THROUGH && action->effect != PM_LOGGER_FILLS &&
            response > 0 && !c->free_scale) {
            // Heat enters an entropy, whose derivative is the capacity over the temperature.
            c->inertia = 1 / response;
            known[action->target] = true;
        }
    }
    for (int c = 0; c < view->nvariable; ++c) {
        if (view->column[c].behind >= 0 && known[view->column[c].behind]) {
            scale_force(w, c);
        }
    }
    for (int rounds = 0; rounds < view->nvariable; ++rounds) {
        int from = -1, to = -1, by = -1, back = -1;
        bool guided = false;
        for (int i = 0; i < view->nvariable && !guided; ++i) {
            for (int j = 0; j < view->nvariable && !guided; ++j) {
                bool both = view->gyrates[i][j] || view->gyrates[j][i] || view->circles[i][j] ||
                            view->circles[j][i];
                for (int q = 0; q < view->nvariable && !both; ++q) {
                    both = pm_logger_guides(view, q, i) && pm_logger_guides(view, q, j);
                }
                if (both && known[i] && !known[j]) {
                    from = i, to = j, guided = true;
                }
            }
        }
        double best = guided ? INFINITY : 0;
        for (int i = 0; i < view->nvariable; ++i) {
            for (int j = 0; j < view->nvariable; ++j) {
                const double share = view->falls[i][j] ? view->share[j][i]
                                                       : fmin(view->share[i][j], view->share[j][i]);
                const bool thermal = view->column[i].kind == PM_LOGGER_TEMPERATURE;
                // Velocities that share an inertia seem to move each other, by next to nothing.
                const bool may = view->column[i].mate < 0 || view->column[j].mate < 0 ||
                                 share > PM_LOGGER_SPRINGS;
                if (known[i] && !known[j] && may && share > best && is_coenergy(&view->column[j]) &&
                    thermal == (view->column[j].kind == PM_LOGGER_TEMPERATURE)) {
                    best = share, from = i, to = j, by = -1;
                }
                // A spring between two bodies pushes both: j moves q, and i moves r, which is q
                // where their distance is measured.
                for (int q = 0; q < view->nvariable; ++q) {
                    for (int r = 0; r < view->nvariable; ++r) {
                        const double both = fmin(view->share[i][q], view->share[j][r]);
                        if (known[i] && !known[j] && both > fmax(best, PM_LOGGER_SPRINGS) &&
                            rate_of(view, q, j) != 0 && rate_of(view, r, i) != 0 &&
                            (q == r || (rate_of(view, q, i) == 0 && rate_of(view, r, j) == 0))) {
                            best = both, from = i, to = j, by = q, back = r;
                        }
                    }
                }
            }
        }
        if (guided) { // both have a part in one energy; to begin with, equally large ones
            const double ratio = view->column[from].deviation / view->column[to].deviation;
            view->column[to].inertia = view->column[from].inertia * ratio * ratio;
        } else if (by >= 0) {
            view->column[to].inertia = view->column[from].inertia *
                                       fabs(view->coupling[from][by] / view->coupling[to][back] *
                                            rate_of(view, by, to) / rate_of(view, back, from));
        } else if (from >= 0) {
            const double returns = view->coupling[to][from];
            const bool falls = view->falls[from][to];
            view->column[to].inertia =
                view->column[from].inertia *
                fabs((falls ? view->column[from].decay : view->coupling[from][to]) / returns);
        } else {
            // Nothing fixes the scale of what is left: that of the first becomes the unit.
            for (to = 0; to < view->nvariable && (known[to] || !is_coenergy(&view->column[to]));) {
                ++to;
            }
            if (to == view->nvariable) {
                break;
            }
            // Other velocities of a part may share an inertia with it: to begin with, they have
            // equal energies.
            pm_logger_column *unit = &view->column[to];
            int like = -1;
            for (int i = 0; i < view->nvariable; ++i) {
                const pm_logger_column *y = &view->column[i];
                like = known[i] && y->part == unit->part && y->mate >= 0 && unit->mate >= 0 &&
                               pm_logger_is_velocity(y) && pm_logger_is_velocity(unit)
                           ? i
                           : like;
            }
            const double ratio = like >= 0 && unit->deviation > 0
                                     ? view->column[like].deviation / unit->deviation
                                     : 0;
            unit->inertia = ratio > 0 ? view->column[like].inertia * ratio * ratio : 1;
            unit->free_scale = !(ratio > 0);
        }
        known[to] = true;
    }
    for (int c = 0; c < view->nvariable; ++c) {
        if (view->column[c].behind >= 0 && view->column[view->column[c].behind].mate >= 0) {
            scale_force(w, c);
        }
    }
    int kept = 0;
    for (int a = 0; a < view->naction; ++a) {
        pm_logger_action *action = &view->action[a];
        const pm_logger_column *c = &view->column[action->target];
        if (action->effect != PM_LOGGER_FILLS) {
            action->gain = c->inertia * view->coupling[action->target][action->input];
        }
        // An input moves all velocities that share an inertia, but acts on one of them alone.
        if (action->effect != PM_LOGGER_GAIN || !find_mutual(view, action)) {
            view->action[kept++] = *action;
        }
    }
    view->naction = kept;
    // The slower of two hidden forces begins as the faster one, but for its rate and its stiffness.
    for (int x = 0; x < view->nvariable; ++x) {
        pm_logger_column *column = &view->column[x];
        const int twin = column->twin, y = column->behind;
        if (twin == 0) {
            continue;
        }
        const pm_logger_column *faster = &view->column[twin];
        column->deviation = faster->deviation;
        column->least = faster->least;
        column->largest = faster->largest;
        column->inertia = faster->inertia;
        column->decay = faster->decay / SLOWER;
        view->coupling[y][x] = SOFTER * view->coupling[y][twin];
        view->coupling[x][y] = SOFTER * view->coupling[twin][y];
        view->share[y][x] = view->share[y][twin];
        view->share[x][y] = view->share[twin][y];
    }
}

// --- parts ---

static int find_part(const pm_logger_view *view, const char *text, size_t length) {
    for (int i = 0; i < view->npart; ++i) {
        if (strlen(view->part[i]) == length && strncmp(view->part[i], text, length) == 0) {
            return i;
        }
    }
    return -1;
}

static pm_status read_parts(pm_logger_view *view, const pm_logger_hints *hints) {
    for (int c = 0; c < view->ncolumn; ++c) {
        view->column[c].part = hints->npart == 0 ? 0 : -1;
    }
    view->part[view->npart++] = "system";
    for (int i = 0; i < hints->npart; ++i) {
        const char *text = hints->part[i];
        size_t length = strcspn(text, "=");
        if (i == PM_LOGGER_PARTS || text[length] == '\0') {
            return pm_fail(
                PM_EUSAGE,
                "--part: expected at most %d of the form NAME=COLUMN,..., found \"%.60s\"",
                PM_LOGGER_PARTS, text);
        }
        view->part[i] = pm_arena_printf(&view->arena, "%.*s", (int)length, text);
        PM_TRY(pm_arena_status(&view->arena, "parts"));
        view->npart = i + 1;
        for (text += length; *text != '\0'; text += length) {
            length = strcspn(++text, ",");
            int c = 0;
            while (c < view->ncolumn && (strlen(view->column[c].source) != length ||
                                         strncmp(view->column[c].source, text, length) != 0)) {
                ++c;
            }
            bool left = false;
            for (int k = 0; k < view->nleft; ++k) {
                left = left || (strlen(view->left[k]) == length &&
                                strncmp(view->left[k], text, length) == 0);
            }
            if (left) {
                continue;
            }
            if (c == view->ncolumn) {
                return pm_fail(PM_EUSAGE, "--part: the tables have no column \"%.*s\"", (int)length,
                               text);
            }
            view->column[c].part = i;
        }
    }
    for (int c = 0; c < view->nvariable; ++c) {
        if (view->column[c].part < 0) {
            return pm_fail(PM_EUSAGE, "--part: column \"%s\" belongs to no part and is no input",
                           view->column[c].source);
        }
    }
    return PM_OK;
}

// Returns true if variable j changes i: it explains a part of its changes, or a part of what all
// columns leave unexplained, as a weak friction does.
static bool changes(const pm_logger_view *view, int i, int j) {
    const double share = view->share[i][j];
    return share > COUPLED || share > fmax(FAINT, NOTABLE * view->column[i].unexplained);
}

// Returns true if level j raises level i, by more than the bend of other outflows could feign.
static bool raises(const pm_logger_view *view, int i, int j) {
    const pm_logger_column *a = &view->column[i], *b = &view->column[j];
    return i != j && a->kind == PM_LOGGER_LEVEL && b->kind == PM_LOGGER_LEVEL &&
           view->coupling[i][j] > 0 &&
           view->share[i][j] > fmax(MOVES, NOTABLE * view->column[i].unexplained);
}

// Returns true if two levels are those of vessels that are connected: each raises the other one.
static bool connects(const pm_logger_view *view, int i, int j) {
    return view->column[i].behind != j && view->column[j].behind != i && raises(view, i, j) &&
           raises(view, j, i);
}

bool pm_logger_is_coupled(const pm_logger_view *view, int i, int j, bool same_kind) {
    const pm_logger_column *a = &view->column[i], *b = &view->column[j];
    if (same_kind && connects(view, i, j)) {
        return true;
    }
    const bool same = pm_unit_equal(&a->dimension, &b->dimension);
    if (same_kind && pm_logger_is_geared(view, i, j)) {
        return true;
    }
    const bool flows[] = {a->kind == PM_LOGGER_FLOW, b->kind == PM_LOGGER_FLOW};
    const bool both = (flows[0] || a->kind == PM_LOGGER_LEVEL) && // a pipe fills a tank
                      (flows[1] || b->kind == PM_LOGGER_LEVEL) && (flows[0] || flows[1]);
    return both && same == same_kind && (same || a->mate < 0 || b->mate < 0) &&
           !(same_kind && (view->circles[i][j] || view->circles[j][i])) &&
           (changes(view, i, j) || changes(view, j, i) || view->assumed[i][j] ||
            (!same_kind && view->multiplies[i][j]));
}

int pm_logger_heated(const pm_logger_view *view, int i, int j) {
    const int own = view->thermometer[view->column[i].part];
    return own >= 0 ? own : view->thermometer[view->column[j].part];
}

bool pm_logger_joins(const pm_logger_view *view, int i, int j) {
    const pm_logger_column *a = &view->column[i], *b = &view->column[j];
    return a->part != b->part &&
           ((a->kind == PM_LOGGER_TEMPERATURE && b->kind == PM_LOGGER_TEMPERATURE) ||
            view->diffuses[i][j] || view->falls[i][j] || view->falls[j][i] || view->warms[i][j] ||
            view->warms[j][i] || view->moves[i][j] != 0 || view->moves[j][i] != 0 ||
            pm_logger_guides(view, i, j) || pm_logger_guides(view, j, i) ||
            pm_logger_is_coupled(view, i, j, false) || pm_logger_is_coupled(view, i, j, true));
}

// Finds the ports: those of the hints, or between parts of which one moves the other.
static pm_status find_ports(pm_logger_view *view, const pm_logger_hints *hints) {
    for (int i = 0; i < hints->nport; ++i) {
        const char *text = hints->port[i];
        const size_t length = strcspn(text, ",");
        const int a = find_part(view, text, length);
        const int b = text[length] == '\0'
                          ? -1
                          : find_part(view, text + length + 1, strlen(text + length + 1));
        if (a < 0 || b < 0 || a == b || i == PM_LOGGER_PARTS * PM_LOGGER_PARTS) {
            return pm_fail(PM_EUSAGE, "--port: expected the names of two parts, found \"%.60s\"",
                           text);
        }
        view->port[view->nport][0] = a;
        view->port[view->nport++][1] = b;
    }
    for (int a = 0; hints->nport == 0 && a < view->npart; ++a) {
        for (int b = a + 1; b < view->npart; ++b) {
            double most = 0;
            for (int i = 0; i < view->nvariable; ++i) {
                for (int j = 0; j < view->nvariable; ++j) {
                    const int pi = view->column[i].part, pj = view->column[j].part;
                    most = (pi == a && pj == b) || (pi == b && pj == a)
                               ? fmax(most, view->share[i][j])
                               : most;
                }
            }
            if (most > MOVES) {
                view->port[view->nport][0] = a;
                view->port[view->nport++][1] = b;
            }
        }
    }
    for (int i = 0; i < view->nvariable; ++i) {
        const pm_logger_column *c = view->column;
        for (int j = 0; j < view->nvariable; ++j) {
            // Fluid falls from what is behind.
            view->falls[i][j] =
                raises(view, j, i) && !connects(view, i, j) && c[j].behind != i &&
                (c[i].behind == j || view->coupling[j][i] > fabs(view->coupling[i][j]));
        }
        // All of it falls into the one that shows it most; others may show what falls on.
        for (int j = 0, into = -1; j < view->nvariable; ++j) {
            if (view->falls[i][j] && into >= 0) {
                const bool more = view->share[j][i] > view->share[into][i];
                view->falls[i][more ? into : j] = false;
                into = more ? j : into;
            } else if (view->falls[i][j]) {
                into = j;
            }
        }
    }
    // Velocities turn into each other by a constant where each changes the other one, with opposite
    // signs.
    for (int i = 0; i < view->nvariable; ++i) {
        for (int j = i + 1; j < view->nvariable; ++j) {
            const pm_logger_column *a = &view->column[i], *b = &view->column[j];
            view->circles[i][j] = a->part == b->part && pm_logger_is_velocity(a) &&
                                  pm_unit_equal(&a->dimension, &b->dimension) &&
                                  changes(view, i, j) && changes(view, j, i) &&
                                  view->coupling[i][j] * view->coupling[j][i] < 0;
        }
    }
    // Find what the ports do: they conduct heat, let fluid fall, and couple co-energies of
    // different kinds.
    for (int i = 0; i < view->nvariable; ++i) {
        const pm_logger_column *a = &view->column[i];
        if (a->kind == PM_LOGGER_POSITION && a->part != view->column[a->mate].part) {
            view->moves[i][a->mate] = a->ratio; // through the port of the parts
        }
        for (int j = 0; j < view->nvariable; ++j) {
            const pm_logger_column *b = &view->column[j];
            if (a->part != b->part && view->falls[i][j]) {
                view->column[i].feeds = view->hides = true;
            }
        }
    }
    return PM_OK;
}

// Assumes a loss between the co-energies of one unit that the two parts of a port have, unless
// springs act from one part to the other, and returns whether there are any.
static bool assume_friction(pm_logger_view *view, const int *parts) {
    bool any = false, linked = false;
    for (int pass = 0; pass < 2; ++pass) {
        for (int i = 0; i < view->nvariable; ++i) {
            for (int j = 0; j < view->nvariable; ++j) {
                const pm_logger_column *a = &view->column[i], *b = &view->column[j];
                const bool own = a->part == parts[0] && b->part == parts[1];
                const bool flows = a->kind == PM_LOGGER_FLOW && b->kind == PM_LOGGER_FLOW &&
                                   a->source != NULL && b->source != NULL;
                linked = linked || (own && pm_logger_is_linked(view, i, j));
                if (pass == 1 && own && flows && !linked &&
                    pm_unit_equal(&a->dimension, &b->dimension)) {
                    view->assumed[i][j] = view->assumed[j][i] = any = true;
                }
            }
        }
    }
    return any;
}

// Leaves out ports through which nothing passes.
static void leave_idle_ports(pm_logger_view *view, const pm_logger_hints *hints) {
    int kept = 0;
    for (int k = 0; k < view->nport; ++k) {
        bool acts = false;
        for (int n = 0; n < view->ntide; ++n) {
            acts = acts ||
                   pm_logger_has_tide(view, &view->tide[n], view->port[k][0], view->port[k][1]);
        }
        for (int i = 0; i < view->nvariable; ++i) {
            for (int j = 0; j < view->nvariable; ++j) {
                acts = acts ||
                       (view->column[i].part == view->port[k][0] &&
                        view->column[j].part == view->port[k][1] && pm_logger_joins(view, i, j));
            }
        }
        // A user who names a port knows that something passes, even if the data do not show it.
        acts = acts || (hints->nport > 0 && assume_friction(view, view->port[k]));
        memcpy(acts ? view->port[kept++] : view->idle[view->nidle++], view->port[k],
               sizeof view->port[k]);
    }
    view->nport = kept;
}

// --- the whole ---

// Returns whether the sensor of a column shows no more than its largest value: it mostly stays
// there once it gets there, and hardly ever stays at another value.
static bool saturates(const pm_logger_samples *w, int c) {
    const pm_dataset *d = w->view->dataset;
    const double top = w->view->column[c].largest;
    int steps[2] = {0}, equal[2] = {0}; // elsewhere, and from the largest value
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 1; k < d->ntime; ++k) {
            const double before = pm_logger_row(w, i, k - 1)[c], now = pm_logger_row(w, i, k)[c];
            if (isfinite(now - before)) {
                ++steps[before == top];
                equal[before == top] += now == before;
            }
        }
    }
    return equal[1] >= FEWEST_AT_TOP && 2 * equal[1] >= steps[1] &&
           equal[0] <= SELDOM_EQUAL * steps[0];
}

// Copies the columns, inputs last, but those whose base[c] is LEFT_OUT. From column c that of
// base[c] is subtracted, unless it is -1.
static pm_status take_columns(pm_logger_samples *w, const pm_logger_hints *hints, const int *base) {
    pm_logger_view *view = w->view;
    const pm_dataset *d = view->dataset;
    const char **unit = NULL;
    bool input[PM_LOGGER_COLUMNS] = {false};
    view->ncolumn = view->nvariable = 0;
    PM_TRY(pm_dataset_units(d, &view->arena, &unit));
    if (2 * d->ncolumn > PM_LOGGER_COLUMNS) {
        return pm_fail(PM_EDATA, "a proposal without a scene takes at most %d columns, found %d",
                       PM_LOGGER_COLUMNS / 2, d->ncolumn);
    }
    // A staircase is an input, if nothing is said.
    for (int c = 0; c < d->ncolumn; ++c) {
        for (int k = 0; k < w->nrow; ++k) {
            w->value[(ptrdiff_t)k * PM_LOGGER_COLUMNS] = d->z[(ptrdiff_t)k * d->ncolumn + c];
        }
        input[c] = pm_logger_measure(w, 0) && hints->inputs == NULL;
    }
    for (const char *text = hints->inputs; text != NULL && *text != '\0';) {
        const size_t n = strcspn(text, ",");
        int c = 0;
        while (c < d->ncolumn &&
               (strlen(d->column[c]) != n || strncmp(d->column[c], text, n) != 0)) {
            ++c;
        }
        if (c == d->ncolumn) {
            return pm_fail(PM_EUSAGE, "--inputs: the tables have no column \"%.*s\"", (int)n, text);
        }
        input[c] = true;
        text += n + (text[n] == ',');
    }
    for (int pass = 0; pass < 2; ++pass) {
        for (int c = 0; c < d->ncolumn; ++c) {
            if (input[c] != (pass == 1) || base[c] == LEFT_OUT) {
                continue;
            }
            pm_logger_column *column = &view->column[view->ncolumn];
            // A name for a group of the scene.
            const char *letter = isalpha((unsigned char)*d->column[c]) ? "" : "c";
            char *name = pm_arena_printf(&view->arena, "%s%.40s", letter, d->column[c]);
            for (char *at = name; at != NULL && *at != '\0'; ++at) {
                *at = isalnum((unsigned char)*at) ? *at : '_';
            }
            *column = (pm_logger_column){.name = name,
                                         .source = d->column[c],
                                         .id = c,
                                         .base = base[c],
                                         .delay = hints->delay != NULL ? hints->delay[c] : 0,
                                         .kind = pass == 1 ? PM_LOGGER_INPUT : PM_LOGGER_FLOW,
                                         .mate = -1,
                                         .behind = -1,
                                         .inertia = 1};
            PM_TRY(pm_arena_status(&view->arena, "columns"));
            const pm_unit own = pm_unit_parse(unit == NULL ? "" : unit[c]);
            column->dimension = own;
            column->unit = si_unit(view, unit == NULL ? "" : unit[c], &own);
            column->dimension.factor = 1;
            column->dimension.offset = 0;
            const pm_unit number = pm_unit_parse("1");
            column->angle = own.angle && pm_unit_equal(&own, &number);
            const int from = base[c];
            const pm_unit other = pm_unit_parse(from < 0 || unit == NULL ? "" : unit[from]);
            for (int k = 0; k < w->nrow; ++k) {
                const double *row =
                    d->z + (ptrdiff_t)pm_logger_earlier(k, column->delay, d->ntime) * d->ncolumn;
                w->value[(ptrdiff_t)k * PM_LOGGER_COLUMNS + view->ncolumn] =
                    own.factor * row[c] + own.offset -
                    (from < 0 ? 0 : other.factor * row[from] + other.offset);
            }
            ++view->ncolumn;
            (void)pm_logger_measure(w, view->ncolumn - 1);
            pm_hold hold = PM_HOLD_SMOOTH; // of a column that changes seldom, or jumps
            PM_TRY(pass == 1 ? pm_hold_of_column(d, c, &hold) : PM_OK);
            column->held = column->held || hold == PM_HOLD_PREVIOUS;
            // A formula tells what a sensor shows in the units of the data.
            column->saturates =
                pass == 0 && own.factor == 1 && own.offset == 0 && saturates(w, view->ncolumn - 1);
        }
        view->nvariable = pass == 0 ? view->ncolumn : view->nvariable;
    }
    return view->nvariable > 0 ? PM_OK : pm_fail(PM_EDATA, "all columns are inputs");
}

// Returns what a column shows in place of a variable: nothing but noise, from which no trial could
// learn, a rate, which is a function of the variables, or what a logger adds; NULL: it may be a
// variable.
static const char *shows_no_variable(const pm_logger_samples *w, int c) {
    const pm_dataset *d = w->view->dataset;
    const pm_logger_column *column = &w->view->column[c];
    bool two = true, counts = true; // it has two values; all steps are equal
    double step = NAN;
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0; k < d->ntime; ++k) {
            const double y = pm_logger_row(w, i, k)[c];
            const double own = k > 0 ? y - pm_logger_row(w, i, k - 1)[c] : NAN;
            two = two && (!isfinite(y) || y == column->least || y == column->largest);
            step = isfinite(step) ? step : own;
            counts = counts && !(fabs(own - step) > EQUAL * fabs(step));
        }
    }
    return column->least == column->largest   ? "one value"
           : two                              ? "two values; --inputs names it if it acts"
           : counts                           ? "the number or the time of a sample"
           : column->roughness > NOTHING_ELSE ? "nothing but noise"
           : has_unit(column, "W")            ? "a power, and no variable"
           : has_unit(column, "m/s^2") || has_unit(column, "rad/s^2")
               ? "an acceleration, and no variable"
               : NULL;
}

// Leaves out columns that are no variables, unless all are none.
static void leave_columns(const pm_logger_samples *w, int *base) {
    pm_logger_view *view = w->view;
    int count = 0;
    for (int c = 0; c < view->nvariable; ++c) {
        count += shows_no_variable(w, c) != NULL;
    }
    for (int c = 0; c < view->nvariable && count < view->nvariable; ++c) {
        const char *why = shows_no_variable(w, c);
        if (why != NULL) {
            view->left[view->nleft] = view->column[c].source;
            view->why_left[view->nleft++] = why;
            base[view->column[c].id] = LEFT_OUT;
        }
    }
}

// Offers more guesses to trials: friction heats the temperature of a neighbour, an entropy depends
// on the positions of its part, and inertias do not depend on a length.
static void offer_laws(pm_logger_view *view) {
    for (int c = 0; c < view->nvariable; ++c) {
        pm_logger_column *y = &view->column[c];
        bool may[PM_LOGGER_NGUESS] = {false};
        for (int j = 0; j < view->nvariable; ++j) {
            const pm_logger_column *other = &view->column[j];
            const bool near = j == view->thermometer[other->part] && other->part != y->part &&
                              pm_logger_meets(view, y->part, other->part);
            const bool cold = y->kind == PM_LOGGER_FLOW && view->thermometer[y->part] < 0;
            may[PM_LOGGER_WARMER] = may[PM_LOGGER_WARMER] || (near && cold);
            may[PM_LOGGER_EXPANDED] =
                may[PM_LOGGER_EXPANDED] ||
                (y->kind == PM_LOGGER_TEMPERATURE && other->kind == PM_LOGGER_POSITION &&
                 other->part == y->part && !view->expands[j][c]);
        }
        may[PM_LOGGER_CYCLIC] = y->kind == PM_LOGGER_POSITION && !y->angle && !y->guided &&
                                view->inertial[y->part] && y->guess != PM_LOGGER_CYCLIC;
        for (int g = PM_LOGGER_WARMER; g < PM_LOGGER_CELL; ++g) {
            if (may[g] && y->source != NULL && y->nother < PM_LOGGER_NGUESS) {
                y->other[y->nother++] = (pm_logger_guess)g;
            }
        }
    }
}

static pm_status look(pm_logger_view *view, const pm_dataset *dataset, const pm_logger_hints *hints,
                      int *base) {
    pm_logger_samples w = {.view = view, .nrow = dataset->ntrajectory * dataset->ntime};
    const size_t n = (size_t)w.nrow;
    pm_status status;
    *view = (pm_logger_view){.dataset = dataset};
    w.value = pm_arena_array(&view->arena, n * PM_LOGGER_COLUMNS, sizeof *w.value);
    w.time = pm_arena_array(&view->arena, n, sizeof *w.time);
    w.sort = pm_arena_array(&view->arena, n, sizeof *w.sort);
    w.window = pm_arena_array(&view->arena, n * (2 * PM_LOGGER_COLUMNS + 2), sizeof *w.window);
    w.squares = pm_arena_array(&view->arena, 1, sizeof *w.squares);
    PM_TRY_DONE(pm_arena_status(&view->arena, "the columns of a logger"));
    for (int k = 0; k < w.nrow; ++k) {
        w.time[k] = pm_dataset_time(dataset, k / dataset->ntime, k % dataset->ntime);
    }
    PM_TRY_DONE(take_columns(&w, hints, base));
    pm_logger_find_noise(&w);
    leave_columns(&w, base);
    if (view->nleft > 0) {
        PM_TRY_DONE(take_columns(&w, hints, base));
        pm_logger_find_noise(&w);
    }
    PM_TRY_DONE(read_parts(view, hints));
    PM_TRY_DONE(find_kinds(&w, hints));
    for (int c = 0; c < view->nvariable; ++c) {
        const pm_logger_column *column = &view->column[c];
        if (column->source == NULL && column->seen == NULL) {
            view->column[c].part =
                view->column[column->mate >= 0 ? column->mate : column->behind].part;
        }
    }
    for (int c = 0; c < view->nvariable; ++c) {
        pm_logger_column *column = &view->column[c];
        column->saturates = column->saturates && column->mate < 0 && column->source != NULL;
        view->hides = view->hides || column->saturates;
    }
    w.seeks_delays = hints->delay == NULL && view->even;
    pm_logger_regress_all(&w);
    PM_TRY_DONE(pm_logger_find_guides(&w, true));
    for (int i = 0; i < view->npart; ++i) {
        view->thermometer[i] = -1;
        for (int c = view->nvariable - 1; c >= 0; --c) {
            const pm_logger_column *column = &view->column[c];
            const bool measured = column->part == i && column->source != NULL;
            view->thermometer[i] =
                measured && column->kind == PM_LOGGER_TEMPERATURE ? c : view->thermometer[i];
        }
    }
    PM_TRY_DONE(find_ports(view, hints));
    for (int u = view->nvariable; u < view->ncolumn && hints->guess != NULL; ++u) {
        view->column[u].guess = hints->guess[view->column[u].id];
    }
    find_actions(view);
    find_scales(&w);
    find_heat_of_friction(&w);
    find_exchange(view);
    PM_TRY_DONE(pm_logger_find_terms(&w));
    PM_TRY_DONE(pm_logger_find_reactions(&w));
    offer_laws(view);
    leave_idle_ports(view, hints);
    for (int i = 0; i < view->nvariable; ++i) { // heat without a thermometer is hidden
        for (int j = 0; j < view->nvariable; ++j) {
            const bool rubs = view->column[i].part < view->column[j].part &&
                              pm_logger_is_coupled(view, i, j, true) &&
                              pm_logger_heated(view, i, j) < 0;
            view->column[i].rubs = view->column[i].rubs || rubs;
            view->hides = view->hides || rubs;
        }
    }
    find_surroundings(view);
    status = pm_arena_status(&view->arena, "the columns of a logger");
done:
    if (status != PM_OK) {
        pm_arena_free(&view->arena);
    }
    return status;
}

// A port stores no energy: the spring between two positions of two parts belongs to one of them,
// whose position is then measured from the other one. base[column] becomes that of the other one,
// along each chain of springs, from the position on which something else acts most. A position that
// is held by something else, too, stays as it is. Where the hints name ports, springs are only
// between their parts. Returns whether any is changed.
static bool measure_distances(const pm_logger_view *v, const pm_logger_hints *hints, int *base) {
    double held[PM_LOGGER_COLUMNS] = {0};
    bool linked[PM_LOGGER_COLUMNS] = {false}, done[PM_LOGGER_COLUMNS] = {false}, any = false;
    bool spring[PM_LOGGER_COLUMNS][PM_LOGGER_COLUMNS] = {{false}};
    for (int q = 0; q < v->nvariable; ++q) {
        for (int p = 0; p < v->nvariable; ++p) {
            const int one = v->column[q].part, other = v->column[p].part;
            bool meets = hints->nport == 0 || pm_logger_meets(v, one, other);
            for (int k = 0; k < v->nidle; ++k) {
                meets = meets || pm_logger_has_ends(v->idle[k], one, other);
            }
            spring[q][p] = meets && pm_logger_is_linked(v, q, p);
            if (meets && v->tethered[q][p]) {
                base[v->column[q].id] = v->column[p].id;
                any = done[q] = done[p] = true;
            }
        }
    }
    for (int q = 0; q < v->nvariable; ++q) {
        const double *moves = v->coupling[v->column[q].mate >= 0 ? v->column[q].mate : q];
        double sum = moves[q];
        for (int p = 0; p < v->nvariable; ++p) {
            linked[q] = linked[q] || spring[q][p];
            sum += spring[q][p] ? moves[p] : 0;
        }
        held[q] = fabs(sum / moves[q]);
    }
    for (int parts = 0; parts < v->nvariable; ++parts) {
        // The next of a chain, or the first of another one.
        int next = -1, from = -1;
        for (int q = 0; q < v->nvariable; ++q) {
            for (int p = 0; p < v->nvariable && done[q]; ++p) {
                if (!done[p] && spring[q][p]) {
                    next = p, from = q;
                }
            }
        }
        for (int q = 0; q < v->nvariable && from < 0; ++q) {
            next = linked[q] && !done[q] && (next < 0 || held[q] > held[next]) ? q : next;
        }
        if (next >= 0) {
            done[next] = true;
        }
        // Springs that pass between the same two parts are one, in several directions.
        double all = 0, count = 0;
        for (int q = 0; q < v->nvariable && from >= 0; ++q) {
            for (int p = 0; p < v->nvariable; ++p) {
                const bool beside = spring[q][p] && v->column[q].part == v->column[next].part &&
                                    v->column[p].part == v->column[from].part;
                all += beside ? held[q] : 0;
                count += beside;
            }
        }
        if (from >= 0 && all < HELD * count) {
            base[v->column[next].id] = v->column[from].id;
            any = true;
        }
    }
    return any;
}

pm_status pm_logger_look(pm_logger_view *view, const pm_dataset *dataset,
                         const pm_logger_hints *hints) {
    int base[PM_LOGGER_COLUMNS];
    for (int c = 0; c < PM_LOGGER_COLUMNS; ++c) {
        base[c] = -1;
    }
    PM_TRY(look(view, dataset, hints, base));
    if (measure_distances(view, hints, base)) {
        pm_logger_view_free(view);
        for (int c = 0; c < PM_LOGGER_COLUMNS; ++c) { // found again
            base[c] = base[c] == LEFT_OUT ? -1 : base[c];
        }
        PM_TRY(look(view, dataset, hints, base));
    }
    return PM_OK;
}
