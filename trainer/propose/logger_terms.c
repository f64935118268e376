// Products of columns as candidates of a regression.
#include "propose/logger_terms.h"

#include <math.h>
#include <string.h>

#define MOST (1 + PM_LOGGER_COLUMNS + 63) // terms of a regression
#define SPACE 3                           // dimensions
#define ROWS 4                            // around an interval between samples
#define FEWEST_HARMONICS 2
#define MOST_HARMONICS 6
#define KEPT_BACK 5 // each fifth trajectory judges
#define RIDGE 1e-9  // of the diagonal of the normal equations
#define GAINS 2e-3  // of the changes: terms that explain less on trajectories kept back are none
#define PART 0.2 // of what other terms leave: a series of harmonics goes on if it explains so much
#define LONG_WINDOWS 4   // of a trajectory
#define MOSTLY 0.5       // of what other terms leave in long windows: a loss heats a temperature
#define LARGE_PART 0.25  // likewise: inertias depend on positions if that explains so much
#define SMALL_ANGLE 1.2  // rad
#define ORBITS 0.15      // of the largest distance: an orbit comes no nearer to its centre
#define INERTIAL 0.5     // of what products leave: an inertia depends on a position
#define CLEARLY 0.9      // of what other terms leave: these leave clearly less
#define GUIDED 0.01      // of the changes of a position: guides leave no more, beside noise
#define ROUND 0.05       // a factor that differs by less from 1, where units allow it, is 1
#define NEEDED 1.1       // times the rest: a guide is needed if it becomes larger without it
#define NEGLIGIBLE 1e-5  // of the changes: what explains less is not needed
#define AT_REST 0.03     // of the largest value: below it a sign is smooth
#define FAINT 3e-5       // of the changes: a dependence on itself that explains less is none
#define SHOWN 5e-3       // likewise, of what other terms leave
#define DAMPED 10        // times what chance would explain
#define SPRING 1e-3      // of the changes of a velocity that another position explains, by a spring
#define LEVERS_AGREE 0.1 // relative difference of two levers that are the same
#define HELD 0.2         // of what distances explain: where a body is tells no more of its motion
#define PUSHES 0.1       // of the root mean square rate: a constant rate that is smaller is none
#define LIKELY 2         // guesses about an input that are tried
#define WEAKER 0.8       // of the coefficient of another input of the same unit
#define CLEAR 0.4        // of what is unexplained: a guess about an input that is tried first

// A factor of a term.
typedef enum atom_kind {
    ONE,
    VALUE,
    SIZE,
    SIGN,
    SQUARE,
    AWAY,
    SINE,
    COSINE,
    APART, // from another column
    ROOT,  // of the distance from another column, with its sign
    NEAR,  // inverse square of the distance from the centre of two lengths
    ORBIT  // angular velocity about it
} atom_kind;

typedef struct atom {
    int column;
    atom_kind kind;
    int harmonic, sign; // of SINE and COSINE: of harmonic*column + sign*other
    int other;
} atom;

// A product of factors; one that is not set is ONE.
typedef struct regressor {
    atom factor[3];
} regressor;

typedef struct term_list {
    int count;
    int length; // samples of a window; 0: as noise asks
    regressor item[MOST];
} term_list;

static double value_of(const pm_logger_view *v, const double *row, const double *held, atom a) {
    const pm_logger_column *c = &v->column[a.column];
    const double raw = c->held ? held[a.column] : row[a.column];
    const double size = fmax(fabs(c->least), fabs(c->largest));
    const double y = size > 0 ? raw / size : raw;
    switch (a.kind) {
    case ONE:
        return 1;
    case SIZE:
        return fabs(y);
    case SIGN:
        return y / sqrt(y * y + AT_REST * AT_REST);
    case SINE:
        return sin(a.harmonic * raw + (a.sign != 0 ? a.sign * row[a.other] : 0));
    case COSINE:
        return cos(a.harmonic * raw + (a.sign != 0 ? a.sign * row[a.other] : 0));
    case SQUARE:
        return y * y;
    case APART:
        return (raw - row[a.other]) / size;
    case ROOT: {
        const double apart = (raw - row[a.other]) / size;
        return copysign(sqrt(fabs(apart)), apart);
    }
    case NEAR:
        return size * size / (raw * raw + row[a.other] * row[a.other]);
    case ORBIT:
        return (raw * row[v->column[a.other].mate] - row[a.other] * row[c->mate]) /
               (raw * raw + row[a.other] * row[a.other]);
    case AWAY: // from the mean
        return (raw - c->mean) / (c->deviation > 0 ? c->deviation : 1);
    case VALUE:
        break;
    }
    return y;
}

// Returns true if velocities may move another position by a function of this one.
static bool may_be_place(const pm_logger_column *c) {
    const pm_unit number = pm_unit_parse("1");
    return pm_unit_equal(&c->dimension, &number);
}

static double product_of(const pm_logger_view *v, const double *row, const double *held,
                         const regressor *r) {
    return value_of(v, row, held, r->factor[0]) * value_of(v, row, held, r->factor[1]) *
           value_of(v, row, held, r->factor[2]);
}

// Normal equations of the windows that learn, and of those that judge.
typedef struct equations {
    int n, count;
    double matrix[MOST][MOST], right[MOST], square;
    double rest; // what known terms leave unexplained
} equations;

// Solves the first n equations of `learn`, writes the solution x [n], and returns the unexplained
// part of the squares of `judge`.
static double rest_of(const equations *learn, const equations *judge, int n, double *x) {
    double l[MOST][MOST];
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j <= i; ++j) {
            double sum = learn->matrix[i][j] + (i == j ? RIDGE * learn->matrix[i][i] : 0);
            for (int k = 0; k < j; ++k) {
                sum -= l[i][k] * l[j][k];
            }
            if (i == j && !(sum > 0)) {
                sum = INFINITY; // nothing depends on this term
            }
            l[i][j] = i == j ? sqrt(sum) : sum / l[j][j];
        }
        double sum = learn->right[i];
        for (int k = 0; k < i; ++k) {
            sum -= l[i][k] * x[k];
        }
        x[i] = sum / l[i][i];
    }
    for (int i = n - 1; i >= 0; --i) {
        for (int k = i + 1; k < n; ++k) {
            x[i] -= l[k][i] * x[k];
        }
        x[i] /= l[i][i];
    }
    double rest = judge->square;
    for (int i = 0; i < n; ++i) {
        rest -= 2 * x[i] * judge->right[i];
        for (int j = 0; j < n; ++j) {
            rest += x[i] * judge->matrix[i][j] * x[j];
        }
    }
    return judge->square > 0 ? rest / judge->square : 1;
}

// The terms without held factors at the last rows of a trajectory: each is needed by up to six
// intervals between samples.
typedef struct row_products {
    bool held[MOST]; // terms that have a held factor, which are not kept
    int sample[ROWS];
    double value[ROWS][MOST];
} row_products;

static const double *products_at(row_products *p, const pm_logger_samples *w, int trajectory, int k,
                                 const term_list *list) {
    double *value = p->value[k % ROWS];
    if (p->sample[k % ROWS] != k) {
        const double *row = pm_logger_row(w, trajectory, k);
        for (int t = 0; t < list->count; ++t) {
            value[t] = p->held[t] ? NAN : product_of(w->view, row, row, &list->item[t]);
        }
        p->sample[k % ROWS] = k;
    }
    return value;
}

// Fills the equations of the changes of variable `target`: with the integrals of the duration and
// of all columns first if `all` is true, then with those of the terms.
static void set_equations(const pm_logger_samples *w, int target, bool all, const term_list *list,
                          equations *learn) {
    const pm_logger_view *v = w->view;
    const pm_dataset *d = v->dataset;
    const int length = list->length > 0 ? list->length : pm_logger_window(w, target);
    const int base = all ? 1 + v->ncolumn : 0;
    equations *judge = learn + 1;
    row_products products;
    memset(learn, 0, 2 * sizeof *learn);
    learn->n = judge->n = base + list->count;
    for (int t = 0; t < list->count; ++t) {
        products.held[t] = false;
        for (int n = 0; n < 3; ++n) {
            const atom *f = &list->item[t].factor[n];
            products.held[t] = products.held[t] || (f->kind != ONE && v->column[f->column].held);
        }
    }
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int n = 0; n < ROWS; ++n) {
            products.sample[n] = -1;
        }
        for (int k = 0; k + length < d->ntime; k += length) {
            double x[MOST] = {0};
            for (int j = k; j < k + length; ++j) {
                const double *first = pm_logger_row(w, i, j), *last = pm_logger_row(w, i, j + 1);
                const double half = (pm_logger_time(w, i, j + 1) - pm_logger_time(w, i, j)) / 2;
                const double *around[] = {pm_logger_near(w, i, j, -1), first, last,
                                          pm_logger_near(w, i, j, 2)};
                const bool whole = around[0] != NULL && around[3] != NULL;
                x[0] += all ? 2 * half : 0;
                for (int c = 0; c < v->ncolumn && all; ++c) {
                    const double scale = v->column[c].deviation > 0 ? v->column[c].deviation : 1;
                    const double next = v->column[c].held ? first[c] : last[c];
                    double y[4] = {0};
                    for (int n = 0; n < 4 && whole && !v->column[c].held; ++n) {
                        y[n] = around[n][c];
                    }
                    x[1 + c] += half *
                                (first[c] + next - 2 * v->column[c].mean + 2 * pm_logger_bend(y)) /
                                scale;
                }
                const double *value[4];
                for (int n = 0; n < 4; ++n) {
                    value[n] =
                        around[n] == NULL ? NULL : products_at(&products, w, i, j - 1 + n, list);
                }
                for (int t = 0; t < list->count; ++t) {
                    const regressor *r = &list->item[t];
                    const bool held = products.held[t];
                    const double y[4] = {whole && !held ? value[0][t] : 0,
                                         held ? product_of(v, first, first, r) : value[1][t],
                                         held ? product_of(v, last, first, r) : value[2][t],
                                         whole && !held ? value[3][t] : 0};
                    const double bend = whole && !held ? pm_logger_bend(y) : 0;
                    x[base + t] += half * (y[1] + y[2] + 2 * bend);
                }
            }
            const double change =
                pm_logger_row(w, i, k + length)[target] - pm_logger_row(w, i, k)[target];
            bool whole = isfinite(change);
            for (int t = 0; t < learn->n; ++t) {
                whole = whole && isfinite(x[t]);
            }
            equations *e = i % KEPT_BACK == KEPT_BACK - 1 ? judge : learn;
            for (int t = 0; t < e->n && whole; ++t) {
                for (int u = 0; u <= t; ++u) {
                    e->matrix[t][u] += x[t] * x[u];
                }
                e->right[t] += x[t] * change;
            }
            e->square += whole ? change * change : 0;
            e->count += whole;
        }
    }
    for (int k = 0; k < 2; ++k) {
        for (int t = 0; t < learn->n; ++t) {
            for (int u = t + 1; u < learn->n; ++u) {
                learn[k].matrix[t][u] = learn[k].matrix[u][t];
            }
        }
    }
}

// Returns how much of the changes of variable `target` the terms explain beside all columns and the
// first `known` terms of the list, on the trajectories that are kept back. Writes all coefficients
// to `solution` [MOST], unless it is NULL: those of the duration, of the columns relative to their
// mean and deviation, and of the terms.
static double gain_of(const pm_logger_samples *w, int target, const term_list *list, int known,
                      equations *learn, double *solution) {
    const int base = 1 + w->view->ncolumn;
    learn->rest = 0;
    if (list->count == known || base + list->count > MOST) {
        return 0;
    }
    double x[MOST];
    set_equations(w, target, true, list, learn);
    const double without = rest_of(learn, learn + 1, base + known, x);
    const double with = rest_of(learn, learn + 1, learn->n, x);
    learn->rest = without;
    if (solution != NULL) {
        memcpy(solution, x, sizeof x);
    }
    return without - with;
}

// Takes the couplings of variable i from the solution x of gain_of.
static void set_couplings(pm_logger_view *v, int i, const double *x) {
    v->column[i].constant = x[0];
    for (int j = 0; j < v->ncolumn; ++j) {
        const double deviation = v->column[j].deviation > 0 ? v->column[j].deviation : 1;
        v->coupling[i][j] = x[1 + j] / deviation;
        v->column[i].constant -= v->coupling[i][j] * v->column[j].mean;
    }
    v->column[i].decay = -v->coupling[i][i];
}

static void add_term(term_list *list, int a, atom_kind one, int b, atom_kind other) {
    if (list->count < MOST) {
        list->item[list->count++] =
            (regressor){{{.column = a, .kind = one}, {.column = b, .kind = other}}};
    }
}

// Adds products of a factor with sines and cosines of an angle.
static void add_angle(term_list *list, int column, atom_kind kind, int angle, int first, int last) {
    for (int k = 2 * first; k < 2 * last + 2 && list->count < MOST; ++k) {
        list->item[list->count++] =
            (regressor){{{.column = column, .kind = kind},
                         {.column = angle, .kind = k % 2 == 0 ? SINE : COSINE, .harmonic = k / 2}}};
    }
}

// --- positions that velocities move by what angles tell ---

// Keeps the equations of the terms in `keep`, and solves them as rest_of does.
static double rest_of_some(const equations *e, const bool *keep, equations *work, double *x) {
    for (int k = 0; k < 2; ++k) {
        int n = 0;
        for (int i = 0; i < e[k].n; ++i) {
            int m = 0;
            for (int j = 0; j < e[k].n && keep[i]; ++j) {
                if (keep[j]) {
                    work[k].matrix[n][m++] = e[k].matrix[i][j];
                }
            }
            work[k].right[n] = e[k].right[i];
            n += keep[i];
        }
        work[k].n = n;
        work[k].square = e[k].square;
    }
    return rest_of(work, work + 1, work->n, x);
}

// Finds how velocities, and inputs that fill it, move column q, if they do.
static void find_guide(pm_logger_samples *w, int q, equations *e) {
    pm_logger_view *v = w->view;
    pm_logger_column *place = &v->column[q];
    term_list list = {0};
    for (int i = 0; i < v->nvariable; ++i) {
        if (!pm_logger_is_velocity(&v->column[i])) {
            continue;
        }
        // Its products with functions of the angles and the pure numbers of the two parts.
        add_term(&list, i, VALUE, i, ONE);
        for (int a = 0; a < v->nvariable; ++a) {
            const pm_logger_column *angle = &v->column[a];
            if ((angle->part != place->part && angle->part != v->column[i].part) ||
                !may_be_place(angle)) {
                continue;
            }
            if (!angle->angle) {
                add_term(&list, i, VALUE, a, VALUE);
                continue;
            }
            add_angle(&list, i, VALUE, a, 1, FEWEST_HARMONICS);
            for (int b = a + 1; b < v->nvariable; ++b) {
                const bool both = v->column[b].angle && v->column[b].part == angle->part;
                for (int k = 0; k < 4 && both && list.count < MOST; ++k) {
                    list.item[list.count++] = (regressor){{{.column = i, .kind = VALUE},
                                                           {.column = a,
                                                            .kind = k % 2 == 0 ? SINE : COSINE,
                                                            .harmonic = 1,
                                                            .other = b,
                                                            .sign = k < 2 ? 1 : -1}}};
                }
            }
        }
    }
    const int moving = list.count;
    const pm_unit second = pm_unit_parse("s");
    for (int u = v->nvariable; u < v->ncolumn && place->dimension.known; ++u) {
        const pm_unit filled = pm_unit_product(&v->column[u].dimension, &second);
        if (pm_unit_equal(&filled, &place->dimension)) {
            add_term(&list, u, VALUE, u, ONE);
        }
    }
    if (moving == 0 || list.count == MOST) {
        return;
    }
    double x[MOST];
    bool keep[MOST];
    set_equations(w, q, false, &list, e);
    for (int k = 0; k < list.count; ++k) {
        keep[k] = true;
    }
    // Noise of both ends of a window is no change that velocities could explain.
    const double noise =
        2 * place->noise * place->noise * e[1].count / (e[1].square > 0 ? e[1].square : 1);
    const double most = GUIDED + 2 * noise;
    double rest = rest_of_some(e, keep, e + 2, x);
    if (!(rest < most)) {
        return;
    }
    // Terms without which the others explain nearly as much are left out, the least needed first.
    for (bool less = true; less;) {
        int least = -1;
        double best = rest * NEEDED + NEGLIGIBLE;
        for (int k = 0; k < list.count; ++k) {
            if (keep[k]) {
                keep[k] = false;
                const double without = rest_of_some(e, keep, e + 2, x);
                keep[k] = true;
                if (without < best) {
                    best = without, least = k;
                }
            }
        }
        less = least >= 0;
        if (less) {
            keep[least] = false;
        }
    }
    rest = rest_of_some(e, keep, e + 2, x);
    int mate = -1;
    bool near = false;
    double own = 0;
    for (int k = 0, n = 0; k < list.count; ++k) {
        const atom *a = list.item[k].factor;
        const pm_logger_column *y = &v->column[a->column];
        if (!keep[k] || v->nguide == PM_LOGGER_GUIDES) {
            continue;
        }
        const double size = fmax(fabs(y->least), fabs(y->largest));
        double factor = x[n++] / size;
        if (k >= moving) {
            if (fabs(fabs(factor) - 1) < ROUND && v->naction < PM_LOGGER_ACTIONS) {
                v->action[v->naction++] = (pm_logger_action){.input = a->column,
                                                             .target = q,
                                                             .effect = PM_LOGGER_FILLS,
                                                             .gain = copysign(1, factor)};
            }
            continue;
        }
        // A velocity of its own part is its rate before all others.
        const double moved = fabs(factor) * y->deviation;
        const bool home = y->part == place->part;
        const bool better = mate < 0 || home > near || (home == near && moved > own);
        if (better) {
            own = moved, near = home, mate = a->column;
        }
        if (a[1].kind == VALUE) {
            const pm_logger_column *g = &v->column[a[1].column];
            factor /= fmax(fabs(g->least), fabs(g->largest));
        }
        const pm_unit rate = pm_unit_product(&y->dimension, &second);
        const bool one = pm_unit_equal(&rate, &place->dimension) && fabs(fabs(factor) - 1) < ROUND;
        v->guide[v->nguide++] = (pm_logger_guide){.position = q,
                                                  .velocity = a->column,
                                                  .function = "1xsc"[a[1].kind == ONE     ? 0
                                                                     : a[1].kind == VALUE ? 1
                                                                     : a[1].kind == SINE  ? 2
                                                                                          : 3],
                                                  .harmonic = a[1].harmonic,
                                                  .angle = a[1].column,
                                                  .other = a[1].sign != 0 ? a[1].other : -1,
                                                  .sign = a[1].sign,
                                                  .factor = one ? copysign(1, factor) : factor};
    }
    if (mate < 0) {
        return;
    }
    place->kind = PM_LOGGER_POSITION;
    place->mate = mate;
    place->ratio = 1;
    place->guided = false;
    for (int k = 0; k < v->nguide; ++k) {
        place->guided = place->guided || (v->guide[k].position == q && v->guide[k].function != '1');
    }
    while (!place->guided && v->nguide > 0 && v->guide[v->nguide - 1].position == q) {
        const pm_logger_guide *g = &v->guide[--v->nguide]; // nothing turns
        *(g->velocity == mate ? &place->ratio : &v->moves[q][g->velocity]) = g->factor;
    }
    place->waves = place->angle;
    v->column[mate].mate = v->column[mate].mate < 0 ? q : v->column[mate].mate;
}

// Returns how much forces towards a centre, which fall with the distance from it, explain of the
// changes of velocity i.
static double pull_of(const pm_logger_samples *w, int i, equations *work) {
    const pm_logger_view *v = w->view;
    const int q = v->column[i].mate;
    double most = 0;
    for (int r = 0; r < v->nvariable && q >= 0; ++r) {
        const pm_logger_column *a = &v->column[q], *b = &v->column[r];
        const atom x = {.column = q, .kind = VALUE};
        const atom near = {.column = q, .kind = NEAR, .other = r};
        term_list forces = {0};
        if (r != q && b->mate >= 0 && !a->guided && !b->guided && !a->angle && !b->angle &&
            a->part == b->part && pm_unit_equal(&a->dimension, &b->dimension)) {
            add_term(&forces, i, VALUE, i, SIZE);
            forces.item[forces.count++] = (regressor){{x, near}};
            forces.item[forces.count++] = (regressor){{x, near, near}};
            most = fmax(most, gain_of(w, i, &forces, 1, work, NULL));
        }
    }
    return most;
}

// Adds the force x^one y^two, powers 0 to 2, of an energy of position q, as it acts on velocity i.
static void add_force(const pm_logger_view *v, term_list *list, int i, atom x, atom y, int q) {
    if (v->column[q].mate == i && !v->column[q].guided && list->count < MOST) {
        list->item[list->count++] = (regressor){{x, y}};
    }
    for (int k = 0; k < v->nguide; ++k) {
        const pm_logger_guide *g = &v->guide[k];
        if (g->velocity == i && g->position == q && list->count < MOST) {
            const atom turn = {.column = g->angle,
                               .kind = g->function == '1'   ? ONE
                                       : g->function == 'x' ? VALUE
                                       : g->function == 's' ? SINE
                                                            : COSINE,
                               .harmonic = g->harmonic,
                               .other = g->other >= 0 ? g->other : 0,
                               .sign = g->sign};
            list->item[list->count++] = (regressor){{x, y, turn}};
        }
    }
}

// Adds the forces by which springs and weights move velocity i: powers of the positions that move
// it and of their differences, sines and cosines of angles.
static void add_springs(const pm_logger_view *v, term_list *list, int i) {
    const int own = v->column[i].mate;
    for (int q = 0; q < v->nvariable; ++q) {
        if (v->column[q].kind != PM_LOGGER_POSITION || (q != own && v->share[i][q] < GAINS)) {
            continue;
        }
        // Sines of small angles hardly differ from powers.
        const bool turns =
            v->column[q].angle && v->column[q].largest - v->column[q].least > 2 * SMALL_ANGLE;
        if (turns) {
            add_angle(list, q, ONE, q, 1, FEWEST_HARMONICS);
        } else {
            add_term(list, q, VALUE, q, VALUE);
            add_term(list, q, VALUE, q, SQUARE);
        }
        if (q != own) {
            add_term(list, own, VALUE, q, VALUE);
            add_term(list, own, VALUE, q, SQUARE);
            add_term(list, own, SQUARE, q, VALUE);
        }
    }
}

// Adds the products of co-energy j and the flows of its part but i and j.
static void add_products(const pm_logger_view *v, term_list *list, int i, int j) {
    for (int k = 0; k < v->nvariable; ++k) {
        if (k != i && k != j && pm_logger_is(v, k, v->column[i].part, PM_LOGGER_FLOW)) {
            add_term(list, j, VALUE, k, VALUE);
        }
    }
}

// Adds what springs, guides and products of velocities are known to change in velocity i.
static void add_known(const pm_logger_view *v, term_list *list, int i) {
    bool turns = false;
    if (v->column[i].mate >= 0 && v->column[i].kind == PM_LOGGER_FLOW &&
        !v->column[v->column[i].mate].guided) {
        add_springs(v, list, i);
    }
    for (int j = 0; j < v->nvariable; ++j) {
        const atom one = {.column = j, .kind = VALUE}, two = {.column = j, .kind = SQUARE};
        if (v->column[j].guided) {
            add_force(v, list, i, one, (atom){0}, j);
            add_force(v, list, i, two, (atom){0}, j);
        }
        turns = turns || v->gyrates[i][j] || v->gyrates[j][i];
        if (v->multiplies[i][j]) {
            add_products(v, list, i, j);
        }
    }
    for (int j = 0; j < v->nvariable && turns; ++j) {
        for (int k = j; k < v->nvariable; ++k) {
            const pm_logger_column *a = &v->column[j], *b = &v->column[k];
            if (a->part == v->column[i].part && b->part == a->part && pm_logger_is_velocity(a) &&
                pm_logger_is_velocity(b)) {
                add_term(list, j, VALUE, k, VALUE);
            }
        }
    }
}

// Returns true if the products of velocity j with velocities change velocity i, more than a pull
// towards a centre would. *bends tells whether they depend on a position, as where an inertia does.
static bool turns_into(const pm_logger_samples *w, int i, int j, equations *work, bool *bends) {
    const pm_logger_view *v = w->view;
    term_list products = {0};
    add_known(v, &products, i);
    add_term(&products, i, VALUE, i, SIZE);
    const int forces = products.count;
    for (int k = 0; k < v->nvariable; ++k) {
        if (pm_logger_is_velocity(&v->column[k]) && v->column[k].part == v->column[i].part) {
            add_term(&products, j, VALUE, k, VALUE);
        }
    }
    const double gain = gain_of(w, i, &products, forces, work, NULL);
    const int known = products.count;
    for (int q = 0; q < v->nvariable; ++q) {
        const pm_logger_column *place = &v->column[q];
        for (int k = forces; k < known && place->kind == PM_LOGGER_POSITION && !place->guided &&
                             (place->mate == i || place->mate == j) && products.count < MOST;
             ++k) {
            regressor *r = &products.item[products.count++];
            *r = products.item[k];
            r->factor[2] = (atom){.column = q, .kind = VALUE};
        }
    }
    *bends = gain > GAINS && gain_of(w, i, &products, known, work, NULL) > INERTIAL * work->rest;
    return gain > GAINS && gain > pull_of(w, i, work);
}

// Finds how much of the changes of variable i each velocity, or each column, explains beside the
// terms of these equations [4], of which the last two are overwritten.
static void share_beside(pm_logger_view *v, int i, bool all, equations *e) {
    double x[MOST];
    bool keep[MOST];
    memset(keep, true, sizeof keep);
    const double rest = rest_of_some(e, keep, e + 2, x);
    v->column[i].unexplained = rest;
    for (int j = 0; j < v->ncolumn; ++j) {
        keep[1 + j] = false;
        v->share[i][j] = all || pm_logger_is_velocity(&v->column[j])
                             ? rest_of_some(e, keep, e + 2, x) - rest
                             : v->share[i][j];
        keep[1 + j] = true;
    }
}

// Adds products of a factor with all positions of a part, or with angles alone.
static void add_positions(const pm_logger_view *v, term_list *list, int part, int column,
                          atom_kind kind, bool lengths) {
    for (int q = 0; q < v->nvariable; ++q) {
        const pm_logger_column *c = &v->column[q];
        if (c->kind != PM_LOGGER_POSITION || c->part != part) {
            continue;
        }
        if (c->angle) {
            add_angle(list, column, kind, q, 1, FEWEST_HARMONICS);
        } else if (lengths) {
            add_term(list, column, kind, q, VALUE);
            add_term(list, column, kind, q, SQUARE);
        }
    }
}

// Adds what inputs change in velocity i by factors that depend on positions.
static void add_levers(const pm_logger_view *v, term_list *list, int i) {
    for (int a = 0; a < v->naction; ++a) {
        if (v->action[a].target == i && v->action[a].lever) {
            add_positions(v, list, v->column[i].part, v->action[a].input, VALUE, true);
        }
    }
}

// Adds squares of the velocities of a part, times functions of its positions: what moves velocities
// where inertias depend on positions.
static void add_squares(const pm_logger_view *v, term_list *list, int part) {
    for (int j = 0; j < v->nvariable; ++j) {
        if (v->column[j].kind == PM_LOGGER_FLOW && v->column[j].part == part &&
            v->column[j].mate >= 0) {
            add_positions(v, list, part, j, SQUARE, true);
        }
    }
}

// Returns true if squares of velocities times sines of twice an angle change velocities, beyond
// what functions of the angle itself and forces do.
static bool bends_twice(const pm_logger_samples *w, int angle, equations *work) {
    const pm_logger_view *v = w->view;
    const int part = v->column[angle].part;
    double gain = 0, rest = 0;
    for (int i = 0; i < v->nvariable; ++i) {
        term_list terms = {0};
        if (!pm_logger_is(v, i, part, PM_LOGGER_FLOW) || v->column[i].mate < 0) {
            continue;
        }
        add_known(v, &terms, i);
        for (int k = 1, known; k <= 2; ++k) {
            known = terms.count;
            for (int j = 0; j < v->nvariable; ++j) {
                if (pm_logger_is(v, j, part, PM_LOGGER_FLOW) && v->column[j].mate >= 0) {
                    add_angle(&terms, j, SQUARE, angle, k, k);
                }
            }
            gain += k == 2 ? gain_of(w, i, &terms, known, work, NULL) : 0;
            rest += k == 2 ? work->rest : 0;
        }
    }
    return gain > GAINS && gain > PART * rest;
}

// Lengths of a part, in which a body may move in the plane or in space.
typedef struct axes {
    int count;
    int length[SPACE];
} axes;

// Returns true if lengths of a part store energy together, as a spring in the plane does: products
// of them in the force on velocity i explain more than springs between them.
static bool stores_on(const pm_logger_samples *w, const axes *a, int i, equations *work) {
    const pm_logger_view *v = w->view;
    // By springs between them, by products, by an inertia that depends on them.
    double gain[3] = {0};
    bool guided = false;
    for (int m = 0; m < a->count; ++m) {
        guided = guided || v->column[a->length[m]].guided;
    }
    for (int k = 0; k < 3; ++k) {
        term_list forces = {0};
        int known = 0;
        for (int pass = 0; pass < 2; ++pass) {
            for (int m = 0; m < a->count * a->count; ++m) {
                const int own = a->length[m / a->count], other = a->length[m % a->count];
                const atom x = {.column = own, .kind = VALUE};
                const atom y = {.column = other, .kind = VALUE};
                const atom xx = {.column = own, .kind = SQUARE};
                const atom yy = {.column = other, .kind = SQUARE};
                const atom d = {.column = own, .kind = APART, .other = other};
                if (pass == 0 && own == other) {
                    add_force(v, &forces, i, x, (atom){0}, own);
                    add_force(v, &forces, i, xx, (atom){0}, own);
                    add_force(v, &forces, i, xx, x, own);
                } else if (pass == 0) {
                    add_force(v, &forces, i, y, (atom){0}, own);
                } else if (own != other && k == 0 && !v->column[own].guided &&
                           v->column[own].mate == i && forces.count + 1 < MOST) {
                    forces.item[forces.count++] = (regressor){{d, d}};
                    forces.item[forces.count++] = (regressor){{d, d, d}};
                } else if (own != other && k == 1) {
                    const atom near = {.column = own, .kind = NEAR, .other = other};
                    add_force(v, &forces, i, x, yy, own);
                    add_force(v, &forces, i, x, y, own);
                    add_force(v, &forces, i, x, near, own);
                }
            }
            known = pass == 0 ? forces.count : known;
        }
        if (k == 2 && known > 0 && !guided) {
            add_squares(v, &forces, v->column[a->length[0]].part);
        }
        gain[k] = forces.count > known ? gain_of(w, i, &forces, known, work, NULL) : 0;
    }
    return gain[1] > GAINS && gain[1] > gain[0] && gain[1] > gain[2];
}

// Returns true if one velocity at least shows that two lengths store energy together.
static bool stores_both(const pm_logger_samples *w, int q, int r, equations *work) {
    const axes pair = {.count = 2, .length = {q, r}};
    bool stores = false;
    for (int i = 0; i < w->view->nvariable && !stores; ++i) {
        stores = stores_on(w, &pair, i, work);
    }
    return stores;
}

// Adds what a spring along the distance of a body from its centre, or from another one, does to
// the body along its axis `k`: products of the three lengths.
static void add_distance(term_list *list, const axes *a, const axes *from, int k) {
    for (int m = 0; m < a->count && list->count < MOST; ++m) {
        atom d[2];
        for (int n = 0; n < 2; ++n) {
            const int axis = n == 0 ? k : m;
            d[n] = (atom){.column = a->length[axis],
                          .kind = from == NULL ? VALUE : APART,
                          .other = from == NULL ? 0 : from->length[axis]};
        }
        list->item[list->count++] = (regressor){{d[0], d[1], d[1]}};
    }
}

// Finds whether a spring acts between two bodies that are measured in the same frame: distances
// between them explain what moves both along all axes. It belongs to the one whose own place tells
// less.
static void find_tether(const pm_logger_samples *w, const axes *a, const axes *b, equations *work) {
    pm_logger_view *v = w->view;
    double apart[2] = {0}, alone[2] = {0}, least = INFINITY;
    for (int m = 0; m < 2 * a->count; ++m) {
        const int end = m % 2, k = m / 2;
        const axes *one = end == 0 ? a : b, *other = end == 0 ? b : a;
        for (int n = 0; n < 2; ++n) {
            term_list forces = {0};
            add_distance(&forces, one, n == 0 ? NULL : other, k);
            const int known = forces.count;
            add_distance(&forces, one, n == 0 ? other : NULL, k);
            const double gain =
                gain_of(w, v->column[one->length[k]].mate, &forces, known, work, NULL);
            *(n == 0 ? &apart[end] : &alone[end]) += gain;
            least = n == 0 ? fmin(least, gain) : least;
        }
    }
    const int end = alone[1] * apart[0] > alone[0] * apart[1] ? 0 : 1;
    const axes *one = end == 0 ? a : b, *other = end == 0 ? b : a;
    for (int k = 0; k < a->count; ++k) {
        v->tethered[one->length[k]][other->length[k]] =
            apart[0] > GAINS && apart[1] > GAINS && alone[end] < HELD * apart[end];
    }
}

// Finds which lengths store energy together, as those of a body in the plane or in space do.
static void find_bodies(pm_logger_samples *w, equations *work) {
    pm_logger_view *v = w->view;
    axes body[PM_LOGGER_PARTS] = {{0}};
    for (int part = 0; part < v->npart; ++part) {
        // Two or three lengths with velocities may be the axes of one body.
        axes *a = &body[part];
        bool one = true;
        for (int q = 0; q < v->nvariable && one; ++q) {
            const pm_logger_column *x = &v->column[q];
            if (x->kind == PM_LOGGER_POSITION && !x->angle && x->part == part) {
                one = a->count < SPACE && !x->guided && v->column[x->mate].part == part &&
                      (a->count == 0 ||
                       pm_unit_equal(&x->dimension, &v->column[a->length[0]].dimension));
                a->length[one ? a->count++ : 0] = q;
            }
        }
        a->count = one && a->count > 1 ? a->count : 0;
        bool stores = a->count == SPACE;
        for (int k = 0; k < a->count && stores; ++k) {
            stores = stores_on(w, a, v->column[a->length[k]].mate, work);
        }
        for (int k = 0; k < a->count * a->count && stores; ++k) {
            const int q = a->length[k / a->count], r = a->length[k % a->count];
            v->central[q][r] = q < r;
        }
    }
    for (int q = 0; q < v->nvariable; ++q) {
        for (int r = q + 1; r < v->nvariable; ++r) {
            const pm_logger_column *a = &v->column[q], *b = &v->column[r];
            v->central[q][r] =
                v->central[q][r] ||
                (a->kind == PM_LOGGER_POSITION && b->kind == PM_LOGGER_POSITION && !a->angle &&
                 !b->angle && a->part == b->part && pm_unit_equal(&a->dimension, &b->dimension) &&
                 stores_both(w, q, r, work));
        }
    }
    // In space the third length may hide what two of them store.
    for (int s = 0; s < v->nvariable; ++s) {
        for (int q = 0; q < v->nvariable; ++q) {
            for (int r = q + 1; r < v->nvariable; ++r) {
                const bool first = v->central[q][s] || v->central[s][q];
                v->central[q][r] =
                    v->central[q][r] || (first && (v->central[r][s] || v->central[s][r]));
            }
        }
    }
    for (int one = 0; one < v->npart; ++one) {
        for (int two = one + 1; two < v->npart; ++two) {
            const axes *a = &body[one], *b = &body[two];
            bool same = a->count > 0 && a->count == b->count;
            for (int i = 0; i < v->nvariable && same; ++i) {
                for (int k = 0; k < a->count; ++k) {
                    same = same && v->moves[a->length[k]][i] == 0 && v->moves[b->length[k]][i] == 0;
                }
            }
            if (same) {
                find_tether(w, a, b, work);
            }
        }
    }
    for (int part = 0; part < v->npart; ++part) {
        axes *a = &body[part];
        for (int k = 0; k < a->count; ++k) {
            a->count = pm_logger_leader(v, a->length[k]) == a->length[0] ? a->count : 0;
        }
    }
    // Friction and all other causes show better beside the springs that move the bodies.
    for (int i = 0; i < v->nvariable; ++i) {
        term_list forces = {0};
        double x[MOST];
        for (int m = 0; m < v->npart * SPACE; ++m) {
            const axes *a = &body[m / SPACE];
            const int k = m % SPACE, q = k < a->count ? a->length[k] : 0;
            if (k < a->count && (v->column[q].mate == i || v->moves[q][i] != 0)) {
                add_distance(&forces, a, NULL, k);
            }
        }
        if (gain_of(w, i, &forces, 0, work, x) > GAINS) {
            share_beside(v, i, true, work);
            for (int j = 0; j < v->nvariable; ++j) {
                const pm_logger_column *y = &v->column[j];
                v->coupling[i][j] = pm_logger_is_velocity(y)
                                        ? x[1 + j] / (y->deviation > 0 ? y->deviation : 1)
                                        : v->coupling[i][j];
            }
            v->column[i].decay = -v->coupling[i][i];
        }
    }
}

pm_status pm_logger_find_guides(pm_logger_samples *w, bool coupled) {
    pm_logger_view *v = w->view;
    equations *work = pm_arena_array(&v->arena, 4, sizeof *work);
    PM_TRY(pm_arena_status(&v->arena, "regressions"));
    for (int i = 0; i < v->nvariable && coupled; ++i) {
        term_list known = {0};
        double x[MOST];
        add_known(v, &known, i);
        if (!(gain_of(w, i, &known, 0, work, x) > GAINS)) {
            continue;
        }
        if (pm_logger_is_rigid(v, i)) { // the others begin with mean slopes
            set_couplings(v, i, x);
        }
        // Beside springs, friction between velocities shows better; all else as well without them.
        share_beside(v, i, pm_logger_is_rigid(v, i), work);
    }
    const pm_unit length = pm_unit_parse("m"), volume = pm_unit_parse("m^3");
    for (int q = 0; q < v->nvariable && !coupled; ++q) {
        const pm_logger_column *place = &v->column[q];
        if (place->mate < 0 && (may_be_place(place) || pm_unit_equal(&place->dimension, &length) ||
                                pm_unit_equal(&place->dimension, &volume))) {
            find_guide(w, q, work);
        }
    }
    // Two velocities turn into each other only if one of them is not the rate of a position.
    // Otherwise an inertia that depends on positions has the same effect.
    for (int i = 0; i < v->nvariable && !coupled; ++i) {
        for (int j = i + 1; j < v->nvariable; ++j) {
            const pm_logger_column *a = &v->column[i], *b = &v->column[j];
            const bool free = a->mate < 0 || v->column[a->mate].guided || b->mate < 0 ||
                              v->column[b->mate].guided;
            if (free && a->part == b->part && pm_logger_is_velocity(a) &&
                pm_logger_is_velocity(b)) {
                bool bends[2];
                const bool one = turns_into(w, i, j, work, &bends[0]);
                const bool other = turns_into(w, j, i, work, &bends[1]);
                v->gyrates[i][j] = (one || other) && !bends[0] && !bends[1];
            }
        }
    }
    if (coupled) {
        find_bodies(w, work);
    }
    return PM_OK;
}

// --- what moves co-energies ---

// Adds the forces of the energy of the position whose velocity is i.
static void add_forces(const pm_logger_view *v, term_list *list, int i) {
    const int q = v->column[i].mate;
    if (v->column[q].waves) {
        add_angle(list, i, ONE, q, 1, FEWEST_HARMONICS);
    }
    if (!v->column[q].waves || v->column[q].springs) {
        add_term(list, q, VALUE, q, VALUE);
        add_term(list, q, VALUE, q, SQUARE);
    }
}

// Finds whether an angle with the velocity i has an energy of sines and cosines, as a weight does,
// of powers, as a spring does, or both: what explains the changes of the velocity. Where both do
// so equally well, small angles have powers, since sines would then hardly differ from each other.
// An angle that turns around has no spring.
static void find_energy(const pm_logger_samples *w, int i, equations *work) {
    pm_logger_column *q = &w->view->column[w->view->column[i].mate];
    double rest[3] = {0}; // of waves, of springs, of both
    for (int k = 0; k < 3; ++k) {
        term_list forces = {0};
        q->waves = k != 1;
        q->springs = k != 0;
        add_forces(w->view, &forces, i);
        rest[k] = -gain_of(w, i, &forces, 0, work, NULL);
        rest[k] += work->rest;
    }
    const bool may = pm_logger_may_spring(q);
    const bool both = may && rest[2] < CLEARLY * fmin(rest[0], rest[1]);
    const bool small = q->largest - q->least < 2 * SMALL_ANGLE;
    q->springs =
        both || (may && (small ? !(rest[0] < CLEARLY * rest[1]) : rest[1] < CLEARLY * rest[0]));
    q->waves = both || !q->springs;
}

static void add_valve(term_list *list, const pm_logger_action *action) {
    add_term(list, action->input, VALUE, action->target, VALUE);
    add_term(list, action->input, SIZE, action->target, VALUE);
    add_term(list, action->input, VALUE, action->input, SIZE);
    add_term(list, action->input, VALUE, action->target, SQUARE);
}

// Finds how many harmonics of its angle the inertia of co-energy i shows, and the levers by which
// inputs act on it.
static void find_harmonics(const pm_logger_samples *w, int i, equations *work) {
    const pm_logger_view *v = w->view;
    const int angle = v->column[i].mate;
    int *most = &w->view->column[angle].harmonics;
    bool more = true;
    while (more && *most < MOST_HARMONICS) {
        term_list turning = {0};
        int known = 0;
        for (int first = 1; first <= *most + 1; first += *most) { // what is known, what comes next
            const int last = first == 1 ? *most : *most + 2;
            known = turning.count;
            add_angle(&turning, i, SQUARE, angle, first, last);
            for (int a = 0; a < v->naction; ++a) {
                if (v->action[a].target == i && v->action[a].effect == PM_LOGGER_GAIN) {
                    add_angle(&turning, v->action[a].input, VALUE, angle, first, last);
                }
            }
        }
        const double gain = gain_of(w, i, &turning, known, work, NULL);
        more = gain > GAINS || gain > PART * work->rest;
        *most += more ? 2 : 0;
    }
}

// Returns true if the product of input u and variable j moves variable i, beyond the effects of
// valves. *raises tells whether it raises it.
static bool converts(const pm_logger_samples *w, int u, int i, int j, equations *work,
                     bool *raises) {
    const pm_logger_view *v = w->view;
    term_list product = {0};
    add_known(v, &product, i);
    for (int a = 0; a < v->naction; ++a) {
        if (v->action[a].target == i && v->action[a].valve) {
            add_valve(&product, &v->action[a]);
        }
    }
    const int first = product.count;
    double x[MOST];
    add_term(&product, u, VALUE, j, VALUE);
    const double gain = gain_of(w, i, &product, first, work, x);
    *raises = x[work->n - 1] > 0;
    return gain > GAINS;
}

// Returns true if the products of co-energy j and third flows move co-energy i. Its own product
// with a velocity would show an inductance that depends on a position.
static bool multiplies(const pm_logger_samples *w, int i, int j, equations *work) {
    term_list products = {0};
    add_known(w->view, &products, i);
    const int known = products.count;
    add_products(w->view, &products, i, j);
    return gain_of(w, i, &products, known, work, NULL) > GAINS;
}

// Finds which co-energies of a part move each other by a factor that depends on what flows.
static void find_products(const pm_logger_samples *w, equations *work) {
    pm_logger_view *v = w->view;
    for (int i = 0; i < v->nvariable; ++i) {
        for (int j = i + 1; j < v->nvariable; ++j) {
            const pm_logger_column *a = &v->column[i], *b = &v->column[j];
            v->multiplies[i][j] = v->multiplies[j][i] =
                a->kind == PM_LOGGER_FLOW && b->kind == PM_LOGGER_FLOW && a->part == b->part &&
                a->source != NULL && b->source != NULL && (a->mate < 0 || b->mate < 0) &&
                !pm_unit_equal(&a->dimension, &b->dimension) && multiplies(w, i, j, work) &&
                multiplies(w, j, i, work);
        }
    }
}

// Finds out whether co-energy i is damped, whether its resistance depends on it, and whether its
// inductance or capacity depends on it. For a hidden variable the data cannot tell, so that all
// three are assumed. A hidden force is only damped, like a velocity.
static void find_bends(const pm_logger_samples *w, int i, equations *work) {
    const pm_logger_view *v = w->view;
    pm_logger_column *y = &w->view->column[i];
    term_list terms = {0};
    double x[MOST];
    bool keep[MOST];
    // Forces of positions hide how a velocity is damped.
    const bool hidden = y->source == NULL || y->mate >= 0;
    add_known(v, &terms, i);
    const int friction = terms.count;
    add_term(&terms, i, SIGN, i, ONE);
    add_term(&terms, i, VALUE, i, SIZE);
    add_term(&terms, i, VALUE, i, SQUARE);
    const int divided = terms.count;
    for (int j = 0; j < v->ncolumn; ++j) {
        if (j != i && v->share[i][j] > GAINS && v->column[j].kind != PM_LOGGER_POSITION) {
            add_term(&terms, j, VALUE, i, VALUE);
            add_term(&terms, j, VALUE, i, SQUARE);
        }
    }
    const int base = 1 + v->ncolumn;
    if (base + terms.count > MOST) { // too many to tell: laws may have all of that
        y->damped = y->curved = y->bent = true;
        return;
    }
    set_equations(w, i, true, &terms, work);
    double rest[4]; // of all, without friction that depends on i, without any, without what divides
    for (int k = 0; k < 4; ++k) {
        for (int t = 0; t < work->n; ++t) {
            const bool own = t == 1 + i;
            const bool loses = t >= base + friction && t < base + divided;
            const bool divides = t >= base + divided;
            keep[t] = !(k == 1 && loses) && !(k == 2 && (loses || own)) && !(k == 3 && divides);
        }
        rest[k] = rest_of_some(work, keep, work + 2, x);
    }
    const double least = fmax(FAINT, SHOWN * rest[0]);
    // A term without any effect explains about one part in `count` by chance.
    const double chance = rest[0] / (work->count > 0 ? work->count : 1);
    const bool force = y->behind >= 0 && v->column[y->behind].mate >= 0;
    y->curved = !force && (hidden || rest[1] - rest[0] > least);
    y->damped = force || y->curved || rest[2] - rest[0] > DAMPED * chance;
    y->bent = hidden || rest[3] - rest[0] > least;
}

// An input that seems to warm a temperature may instead set how well heat is conducted away. In
// this case the temperature falls faster the warmer it is.
static void find_cooling(const pm_logger_samples *w, pm_logger_action *action, equations *work) {
    const pm_logger_column *u = &w->view->column[action->input];
    const pm_logger_column *T = &w->view->column[action->target];
    term_list product = {0};
    double x[MOST];
    add_term(&product, action->input, VALUE, action->target, AWAY);
    if (!(gain_of(w, action->target, &product, 0, work, x) > GAINS)) {
        return;
    }
    const double slope = -x[work->n - 1] / (T->deviation * fmax(fabs(u->least), fabs(u->largest)));
    const double bath = T->mean + x[1 + action->input] / (u->deviation * slope);
    if (slope > 0 && bath > PM_LOGGER_COLDEST && bath < PM_LOGGER_HOTTEST) {
        action->effect = PM_LOGGER_COOLS;
        action->gain = T->inertia * slope;
        action->bath = bath;
    }
}

// Adds what coolants do to temperature i.
static void add_coolants(const pm_logger_view *v, term_list *list, int i) {
    for (int a = 0; a < v->naction; ++a) {
        const pm_logger_action *action = &v->action[a];
        if (action->target == i && action->effect == PM_LOGGER_COOLS) {
            add_term(list, action->input, VALUE, i, AWAY);
            if (action->enters > 0) {
                add_term(list, action->input, VALUE, action->enters, AWAY);
            }
        }
    }
}

// Returns what the terms explain of the changes of variable i, divided by the sum of what stays
// unexplained and of what noise may explain; 0 if they explain hardly any.
static double worth_of(const pm_logger_samples *w, int i, const term_list *list, int known,
                       equations *work, double *x) {
    const double gain = gain_of(w, i, list, known, work, x), noise = w->view->column[i].noise;
    const equations *judge = work + 1;
    const double chance = judge->square > 0 ? 2 * noise * noise * judge->count / judge->square : 1;
    return gain > GAINS ? gain / (work->rest + chance) : 0;
}

// Returns how much an exchange between variables i and j, as strong as input u says, explains of i.
static double opening_of(const pm_logger_samples *w, int u, int i, int j, equations *work) {
    const pm_logger_view *v = w->view;
    const atom opening = {.column = u, .kind = VALUE};
    term_list list = {0};
    add_coolants(v, &list, i);
    const int known = list.count;
    if (!pm_unit_equal(&v->column[i].dimension, &v->column[j].dimension)) {
        add_term(&list, u, VALUE, j, VALUE);
    } else if (list.count + 2 < MOST) {
        list.item[list.count++] = (regressor){{opening, {.column = i, .kind = APART, .other = j}}};
        list.item[list.count++] = (regressor){{opening, {.column = i, .kind = ROOT, .other = j}}};
    }
    return worth_of(w, i, &list, known, work, NULL);
}

// Returns how much of the changes of temperature i the flow u explains if it enters with the
// temperature T, another input. *slope receives the rate of the exchange, 1/s per unit of the flow.
static double entering_of(const pm_logger_samples *w, int u, int T, int i, equations *work,
                          double *slope) {
    const pm_logger_view *v = w->view;
    const pm_logger_column *flow = &v->column[u];
    term_list list = {0};
    double x[MOST] = {0};
    for (int j = 0; j < v->nvariable; ++j) { // beside what the flow may open
        if (v->column[j].kind == PM_LOGGER_TEMPERATURE && v->column[j].part == v->column[i].part) {
            add_term(&list, u, VALUE, j, AWAY);
        }
    }
    add_term(&list, u, VALUE, T, AWAY);
    const double worth = worth_of(w, i, &list, list.count - 1, work, x);
    *slope =
        x[work->n - 1] / (v->column[T].deviation * fmax(fabs(flow->least), fabs(flow->largest)));
    return *slope > 0 ? worth : 0;
}

// Returns true if an input may set how strongly the two exchange something: two of one kind, or
// what it turns into each other.
static bool may_open(const pm_logger_view *v, int u, int i, int j) {
    const pm_logger_column *a = &v->column[i], *b = &v->column[j];
    const bool same = pm_unit_equal(&a->dimension, &b->dimension);
    const bool flows = a->kind == PM_LOGGER_FLOW && b->kind == PM_LOGGER_FLOW;
    const bool kinds = flows ? a->mate < 0 && b->mate < 0
                             : same && a->kind == b->kind &&
                                   (a->kind == PM_LOGGER_TEMPERATURE || a->kind == PM_LOGGER_LEVEL);
    bool known = false;
    for (int k = 0; k < v->nconverter; ++k) {
        const pm_logger_converter *c = &v->converter[k];
        known = known || (c->input == u && c->one == i && c->other == j);
    }
    return kinds && !known && a->part == b->part && a->source != NULL && b->source != NULL &&
           (!same || v->column[u].least >= 0);
}

// Returns the variable or input of this identifier.
static int column_of(const pm_logger_view *v, int id) {
    int found = 0;
    for (int c = 0; c < v->ncolumn; ++c) {
        found = v->column[c].id == id ? c : found;
    }
    return found;
}

// Does what guesses about inputs say.
static void take_guesses(const pm_logger_samples *w, equations *work) {
    pm_logger_view *v = w->view;
    for (int u = v->nvariable; u < v->ncolumn; ++u) {
        int one, other;
        const pm_logger_guess guess = pm_logger_split(v->column[u].guess, &one, &other);
        one = column_of(v, one), other = column_of(v, other);
        if (v->column[u].guess == PM_LOGGER_SCALED) {
            for (int a = 0; a < v->naction; ++a) {
                pm_logger_action *action = &v->action[a];
                const bool drives = action->input == u && action->effect == PM_LOGGER_DRIVES;
                action->effect = drives ? PM_LOGGER_GAIN : action->effect;
            }
        } else if (guess == PM_LOGGER_ENTERS) {
            double slope;
            int at = v->naction;
            (void)entering_of(w, one, u, other, work, &slope);
            for (int a = 0; a < v->naction; ++a) {
                at = v->action[a].input == one && v->action[a].target == other ? a : at;
            }
            if (at == PM_LOGGER_ACTIONS) {
                continue;
            }
            v->naction += at == v->naction;
            v->action[at] = (pm_logger_action){.input = one,
                                               .target = other,
                                               .effect = PM_LOGGER_COOLS,
                                               .gain = v->column[other].inertia * slope,
                                               .enters = u};
            int kept = 0; // it is no bath of its own
            for (int a = 0; a < v->naction; ++a) {
                if (v->action[a].input != u || v->action[a].target != other) {
                    v->action[kept++] = v->action[a];
                }
            }
            v->naction = kept;
        } else if (guess == PM_LOGGER_GATES) {
            v->gate[one] = u;
            int kept = 0; // it moves no other level
            for (int a = 0; a < v->naction; ++a) {
                const pm_logger_column *target = &v->column[v->action[a].target];
                if (v->action[a].input != u || target->kind != PM_LOGGER_LEVEL) {
                    v->action[kept++] = v->action[a];
                }
            }
            v->naction = kept;
        } else if (guess >= PM_LOGGER_OPENS && v->nconverter < PM_LOGGER_ACTIONS) {
            v->converter[v->nconverter++] = (pm_logger_converter){
                u, one, other,
                pm_unit_equal(&v->column[one].dimension, &v->column[other].dimension),
                guess == PM_LOGGER_OPENS_ALONE};
        }
    }
}

// Returns how much of level i an outflow explains that input u opens.
static double gating_of(const pm_logger_samples *w, int u, int i, equations *work) {
    term_list list = {0};
    add_term(&list, u, VALUE, i, VALUE);
    return worth_of(w, i, &list, 0, work, NULL);
}

// Adds a guess to the LIKELY best ones, whose last place is free.
static void insert(double worth[LIKELY + 1], pm_logger_guess guess[LIKELY + 1]) {
    for (int k = LIKELY; k > 0 && worth[k] > worth[k - 1]; --k) {
        const double more = worth[k];
        const pm_logger_guess better = guess[k];
        worth[k] = worth[k - 1], guess[k] = guess[k - 1];
        worth[k - 1] = more, guess[k - 1] = better;
    }
}

// Returns how much of the changes of velocity c input u explains by a factor that depends on
// positions, beside all columns.
static double turning_of(const pm_logger_samples *w, int u, int c, equations *work) {
    term_list list = {0};
    add_known(w->view, &list, c);
    const int known = list.count;
    add_positions(w->view, &list, w->view->column[c].part, u, VALUE, true);
    return gain_of(w, c, &list, known, work, NULL);
}

// Returns true if an input also moves velocities of the part which it drives that it does not act
// on, or if the factor with which it moves one depends on positions.
static bool moves_others(const pm_logger_samples *w, int u, equations *work) {
    const pm_logger_view *v = w->view;
    bool moves = false;
    for (int a = 0; a < v->naction; ++a) {
        const pm_logger_action *action = &v->action[a];
        const int part = v->column[action->target].part;
        for (int c = 0; c < v->nvariable && action->input == u; ++c) {
            bool acts = false;
            for (int b = 0; b < v->naction; ++b) {
                acts = acts || (v->action[b].input == u && v->action[b].target == c &&
                                v->action[b].effect == PM_LOGGER_GAIN);
            }
            moves = moves ||
                    (!acts && v->column[c].part == part && v->column[c].kind == PM_LOGGER_FLOW &&
                     ((c != action->target && v->share[c][u] > GAINS) ||
                      turning_of(w, u, c, work) > GAINS));
        }
    }
    return moves;
}

// Offers to trials what each input may set, the likeliest first. Regressions only rank these
// guesses, because capacities that vary hide the effect; trials decide.
static void offer_openings(const pm_logger_samples *w, equations *work) {
    pm_logger_view *v = w->view;
    const pm_unit kelvin = pm_unit_parse("K");
    for (int u = v->nvariable; u < v->ncolumn; ++u) {
        pm_logger_column *input = &v->column[u];
        double worth[LIKELY + 1] = {0};
        pm_logger_guess guess[LIKELY + 1];
        const bool warm = pm_unit_equal(&input->dimension, &kelvin);
        for (int i = 0; i < v->nvariable; ++i) {
            if (!warm && input->least >= 0 && v->column[i].kind == PM_LOGGER_LEVEL &&
                v->column[i].source != NULL) {
                worth[LIKELY] = gating_of(w, u, i, work);
                guess[LIKELY] = pm_logger_join(PM_LOGGER_GATES, v->column[i].id, v->column[i].id);
                insert(worth, guess);
            }
            for (int j = warm ? v->nvariable : i + 1; j < (warm ? v->ncolumn : v->nvariable); ++j) {
                const pm_logger_column *other = &v->column[j];
                double slope;
                if (!warm && may_open(v, u, i, j)) {
                    worth[LIKELY] =
                        fmax(opening_of(w, u, i, j, work), opening_of(w, u, j, i, work));
                    guess[LIKELY] = pm_logger_join(PM_LOGGER_OPENS, v->column[i].id, other->id);
                } else if (warm && v->column[i].kind == PM_LOGGER_TEMPERATURE &&
                           v->column[i].source != NULL && other->least >= 0 &&
                           !pm_unit_equal(&other->dimension, &kelvin)) {
                    worth[LIKELY] = entering_of(w, j, u, i, work, &slope);
                    guess[LIKELY] = pm_logger_join(PM_LOGGER_ENTERS, other->id, v->column[i].id);
                } else {
                    continue;
                }
                insert(worth, guess);
            }
        }
        for (int k = 0; k < LIKELY && worth[k] > 0; ++k) {
            input->other[input->nother++] = guess[k];
        }
        int one, other;
        input->clear = worth[0] > CLEAR && pm_logger_split(guess[0], &one, &other) > 0 &&
                       v->column[column_of(v, other)].kind != PM_LOGGER_LEVEL;
        // A learned factor is offered only if several inputs drive. The factor of a single input
        // would merely scale the inertia of what it drives. Where another input clearly moves the
        // same variable more, as a torque before a gear does, trials begin with such a factor.
        bool drives = false, others = false, weaker = false;
        for (int a = 0; a < v->naction; ++a) {
            const int c = v->action[a].target;
            const bool own = v->action[a].input == u && v->action[a].effect == PM_LOGGER_DRIVES;
            drives = drives || own;
            for (int b = 0; b < v->naction; ++b) {
                const int beside = v->action[b].input;
                const bool other_drives = beside != u && v->action[b].effect == PM_LOGGER_DRIVES;
                others = others || other_drives;
                weaker =
                    weaker || (own && other_drives && v->action[b].target == c &&
                               v->share[c][u] > v->column[c].unexplained &&
                               WEAKER * fabs(v->coupling[c][beside]) > fabs(v->coupling[c][u]));
            }
        }
        if (drives && others) {
            const int at = weaker ? 0 : input->nother;
            memmove(input->other + at + 1, input->other + at,
                    (size_t)(input->nother - at) * sizeof *input->other);
            input->other[at] = PM_LOGGER_SCALED;
            ++input->nother;
            input->clear = input->clear || weaker;
        }
        if (drives && moves_others(w, u, work)) {
            input->other[input->nother++] = PM_LOGGER_FREELY;
        }
    }
}

// A cell heats the temperature of its part that the square of its current explains best. The power
// of its resistance is known, so that this gives the scale of all capacities, where nothing has
// given it.
static void find_cell_heat(const pm_logger_samples *w, equations *work) {
    pm_logger_view *v = w->view;
    for (int a = 0; a < v->naction; ++a) {
        const int u = v->action[a].input;
        const pm_logger_column *cell = &v->column[v->action[a].target];
        double best = -INFINITY, rise = 0;
        for (int t = 0; t < v->nvariable && cell->seen != NULL; ++t) {
            term_list square = {0};
            double x[MOST] = {0};
            if (v->column[t].kind == PM_LOGGER_TEMPERATURE && v->column[t].part == cell->part &&
                v->column[t].source != NULL) {
                add_term(&square, u, SQUARE, t, ONE);
                const double gain = gain_of(w, t, &square, 0, work, x);
                if (gain > best) {
                    best = gain;
                    rise = x[work->n - 1];
                    v->thermometer[cell->part] = t;
                }
            }
        }
        if (rise > 0 && pm_logger_heat_is_free(v)) {
            const double most = fmax(fabs(v->column[u].least), fabs(v->column[u].largest));
            const double capacity = fabs(cell->resistance) * most * most / rise;
            pm_logger_scale_heat(v, capacity / v->column[v->thermometer[cell->part]].inertia);
        }
        // A thermometer before a hidden body shows its surface: the heat goes into the body.
        for (int h = 0; h < v->nvariable && isfinite(best); ++h) {
            const pm_logger_column *body = &v->column[h];
            if (body->kind == PM_LOGGER_TEMPERATURE && body->part == cell->part &&
                body->behind == v->thermometer[cell->part]) {
                v->thermometer[cell->part] = h;
                break;
            }
        }
        for (int k = 0; k < v->nvariable && isfinite(best); ++k) {
            const pm_logger_column *pair = &v->column[k];
            v->warms[k][v->thermometer[cell->part]] |=
                pair->relaxes > 0 && pair->part == cell->part;
        }
    }
}

// Computes the couplings of temperatures without the effects of inputs. Heat that grows with the
// square of an input, or with its product with the temperature, would otherwise look like
// conduction to further surroundings.
static void correct_leaks(const pm_logger_samples *w, equations *work) {
    pm_logger_view *v = w->view;
    for (int i = 0; i < v->nvariable; ++i) {
        term_list list = {0};
        double x[MOST];
        for (int a = 0; a < v->naction && v->column[i].kind == PM_LOGGER_TEMPERATURE; ++a) {
            const pm_logger_action *action = &v->action[a];
            if (action->target == i && action->effect == PM_LOGGER_WARMS) {
                add_term(&list, action->input, SQUARE, i, ONE);
            } else if (action->target == i && action->effect == PM_LOGGER_COOLS) {
                add_term(&list, action->input, VALUE, i, AWAY);
            }
        }
        if (!(gain_of(w, i, &list, 0, work, x) > GAINS)) {
            continue;
        }
        set_couplings(v, i, x);
    }
}

// Returns true if a length stores energy together with another one.
static bool stores_with_others(const pm_logger_view *v, int q) {
    bool found = false;
    for (int r = 0; r < v->nvariable; ++r) {
        found = found || v->central[q][r] || v->central[r][q];
    }
    return found;
}

// If lengths q and r never come near their centre, finds the spins that their motion about it
// changes by a friction that falls with the distance. Any other coupling of the two would favour
// directions.
static void find_tides(pm_logger_samples *w, int q, int r, equations *work) {
    pm_logger_view *v = w->view;
    double least = INFINITY, largest = 0;
    for (int k = 0; k < w->nrow; ++k) {
        const double *row = w->value + (ptrdiff_t)k * PM_LOGGER_COLUMNS;
        const double distance = hypot(row[q], row[r]);
        least = isfinite(distance) ? fmin(least, distance) : least;
        largest = isfinite(distance) ? fmax(largest, distance) : largest;
    }
    v->orbits[q] = v->orbits[q] || least > ORBITS * largest;
    const pm_unit turn = pm_unit_parse("rad/s");
    for (int i = 0; i < v->nvariable && v->ntide < PM_LOGGER_CARRIERS; ++i) {
        const int part = v->column[i].part, own = v->column[q].part;
        const int moved[] = {i, v->column[q].mate, v->column[r].mate};
        const int heat = v->thermometer[part] >= 0 ? v->thermometer[part] : v->thermometer[own];
        term_list products = {0};
        const atom near = {.column = q, .kind = NEAR, .other = r};
        const atom turning[] = {{.column = q, .kind = ORBIT, .other = r},
                                {.column = i, .kind = VALUE}};
        for (int k = 0; k < 4; ++k) {
            products.item[products.count++] =
                (regressor){{turning[k % 2], near, k < 2 ? (atom){0} : near}};
        }
        if (v->column[i].kind != PM_LOGGER_FLOW || v->column[i].source == NULL ||
            !pm_unit_equal(&v->column[i].dimension, &turn) || !pm_logger_meets(v, part, own) ||
            !(gain_of(w, i, &products, 0, work, NULL) > fmax(GAINS, LARGE_PART * work->rest))) {
            continue;
        }
        v->tide[v->ntide++] = (pm_logger_tide){i, q, r, heat};
        if (heat < 0 && part != own) {
            v->column[i].rubs = v->hides = true;
        }
        for (int a = 0; a < 3; ++a) {
            for (int b = 0; b < 3; ++b) {
                v->gyrates[moved[a]][moved[b]] = v->circles[moved[a]][moved[b]] = false;
                if (a != b) {
                    v->coupling[moved[a]][moved[b]] = v->share[moved[a]][moved[b]] = 0;
                }
            }
            // To begin with, spin and orbit have equally large energies.
            const pm_logger_column *spin = &v->column[i];
            pm_logger_column *y = &v->column[moved[a]];
            const double ratio = spin->deviation / y->deviation;
            y->inertia = a == 0 ? y->inertia : spin->inertia * ratio * ratio;
        }
    }
}

// Adds how a gas with temperature t cools as it expands, beside the columns.
static void add_expansion(const pm_logger_view *v, term_list *list, int t) {
    static const atom_kind power[] = {ONE, VALUE, SQUARE};
    for (int q = 0; q < v->nvariable; ++q) {
        for (int k = 0; k < 2 && v->expands[q][t]; ++k) {
            for (int n = 1 - k; n < 3 && list->count < MOST; ++n) { // the rate itself is a column
                list->item[list->count++] =
                    (regressor){{{.column = v->column[q].mate, .kind = VALUE},
                                 {.column = q, .kind = power[n]},
                                 {.column = t, .kind = k == 0 ? ONE : VALUE}}};
            }
        }
    }
}

// Finds the levers of springs between two positions of a part, and how far apart all columns come.
// The force of a spring is proportional to lever*i - j for both velocities, so that both show the
// same lever if nothing else holds the positions. If they do not, positions of one unit have the
// lever 1, and others have no spring.
static void find_levers(const pm_logger_samples *w) {
    pm_logger_view *v = w->view;
    for (int i = 0; i < v->nvariable; ++i) {
        for (int j = 0; j < v->nvariable; ++j) {
            const pm_logger_column *a = &v->column[i], *b = &v->column[j];
            const bool pair = a->kind == PM_LOGGER_POSITION && b->kind == PM_LOGGER_POSITION &&
                              a->part == b->part && !a->guided && !b->guided && j > i;
            if (pair && fmax(v->share[a->mate][j], v->share[b->mate][i]) > SPRING) {
                const double one = -v->coupling[a->mate][i] / v->coupling[a->mate][j];
                const double other = -v->coupling[b->mate][j] / v->coupling[b->mate][i];
                const double lever = copysign(sqrt(fabs(one / other)), one);
                const bool same =
                    a->angle == b->angle && pm_unit_equal(&a->dimension, &b->dimension);
                const bool shown = fabs(one * other - 1) < LEVERS_AGREE &&
                                   !(same && fabs(lever - 1) < LEVERS_AGREE);
                v->lever[i][j] = shown ? lever : same ? 1 : 0;
                v->lever[j][i] = shown ? 1 / lever : v->lever[i][j];
            }
            const double lever = v->lever[i][j] == 0 ? 1 : v->lever[i][j];
            const double away = lever == 1 ? 0 : lever * a->mean - b->mean; // gears have no zero
            for (int k = 0; k < w->nrow; ++k) {
                const double *row = w->value + (ptrdiff_t)k * PM_LOGGER_COLUMNS;
                v->apart[i][j] = fmax(v->apart[i][j], fabs(lever * row[i] - row[j] - away));
            }
        }
    }
}

pm_status pm_logger_find_terms(pm_logger_samples *w) {
    pm_logger_view *v = w->view;
    equations *work = pm_arena_array(&v->arena, 4, sizeof *work);
    PM_TRY(pm_arena_status(&v->arena, "regressions"));
    for (int c = 0; c < v->nvariable; ++c) {
        v->column[c].harmonics = FEWEST_HARMONICS;
    }
    find_levers(w);
    for (int q = 0; q < v->nvariable; ++q) {
        for (int r = q + 1; r < v->nvariable; ++r) {
            if (v->central[q][r]) {
                find_tides(w, q, r, work);
            }
        }
    }
    find_products(w, work);
    for (int a = 0; a < v->naction; ++a) {
        pm_logger_action *action = &v->action[a];
        const pm_logger_column *y = &v->column[action->target];
        term_list valve = {0};
        if (action->effect == PM_LOGGER_WARMS) {
            find_cooling(w, action, work);
        }
        const bool freely = action->effect == PM_LOGGER_DRIVES &&
                            v->column[action->input].guess == PM_LOGGER_FREELY;
        if (action->effect != PM_LOGGER_GAIN && !freely) {
            continue;
        }
        action->lever = turning_of(w, action->input, action->target, work) > GAINS;
        if (freely) {
            action->effect = action->lever ? PM_LOGGER_GAIN : PM_LOGGER_DRIVES;
            continue;
        }
        add_known(v, &valve, action->target);
        const int known = valve.count;
        add_valve(&valve, action);
        action->valve =
            y->mate < 0 && gain_of(w, action->target, &valve, known, work, NULL) > GAINS;
    }
    find_cell_heat(w, work);
    correct_leaks(w, work);
    // One valve may move two chambers.
    for (int a = 0; a < v->naction; ++a) {
        for (int b = 0; b < v->naction; ++b) {
            const pm_logger_action *one = &v->action[a], *other = &v->action[b];
            v->action[a].valve =
                one->valve || (other->valve && one->input == other->input &&
                               one->effect == PM_LOGGER_GAIN && v->column[one->target].mate < 0 &&
                               pm_unit_equal(&v->column[one->target].dimension,
                                             &v->column[other->target].dimension));
        }
    }
    for (int i = 0; i < v->nvariable; ++i) {
        const pm_logger_column *y = &v->column[i];
        if (y->kind == PM_LOGGER_FLOW && y->mate >= 0 && v->column[y->mate].angle &&
            !v->column[y->mate].guided) {
            find_energy(w, i, work);
        }
    }
    for (int part = 0; part < v->npart; ++part) {
        // Inertias depend on several positions if squares of velocities times functions of
        // positions change velocities, beside forces of the positions.
        double gain = 0, rest = 0;
        for (int i = 0; i < v->nvariable; ++i) {
            const pm_logger_column *y = &v->column[i];
            if (y->part != part || y->kind != PM_LOGGER_FLOW || y->mate < 0 ||
                stores_with_others(v, y->mate)) {
                continue;
            }
            term_list terms = {0};
            add_known(v, &terms, i);
            add_term(&terms, i, VALUE, i, SIZE);
            add_levers(v, &terms, i);
            const int forces = terms.count;
            add_squares(v, &terms, part);
            gain += gain_of(w, i, &terms, forces, work, NULL);
            rest += work->rest;
        }
        v->inertial[part] = gain > GAINS && gain > LARGE_PART * rest;
    }
    for (int q = 0; q < v->nvariable; ++q) {
        if (v->column[q].kind == PM_LOGGER_POSITION && v->column[q].angle) {
            v->column[q].twice = bends_twice(w, q, work);
        }
    }
    for (int i = 0; i < v->nvariable; ++i) {
        const pm_logger_column *y = &v->column[i];
        if (y->kind != PM_LOGGER_FLOW || y->relaxes > 0) {
            continue;
        }
        find_bends(w, i, work);
        term_list turning = {0};
        if (pm_logger_is_rigid(v, i)) {
            // Its inertia is constant: what turns is how it moves positions or other velocities.
        } else if (y->mate >= 0) {
            // Where energy is kept, squares of velocities are functions of the positions. Terms of
            // forces therefore come first.
            const bool angle = v->column[y->mate].angle;
            add_forces(v, &turning, i);
            add_levers(v, &turning, i);
            add_term(&turning, i, VALUE, i, SIZE);
            add_term(&turning, i, VALUE, i, SQUARE);
            const int forces = turning.count;
            if (angle) {
                add_angle(&turning, i, SQUARE, y->mate, 1, FEWEST_HARMONICS);
            } else {
                add_term(&turning, i, SQUARE, y->mate, VALUE);
            }
            v->turns[i] = !stores_with_others(v, y->mate) &&
                          gain_of(w, i, &turning, forces, work, NULL) > GAINS;
            if (v->turns[i] && v->column[y->mate].angle) {
                find_harmonics(w, i, work);
            }
        } else {
            // A capacity that depends on positions divides all that moves the variable, and changes
            // it with the velocities, as a skater spins faster who pulls in the arms.
            for (int q = 0; q < v->nvariable; ++q) {
                const pm_logger_column *place = &v->column[q];
                if (place->kind == PM_LOGGER_POSITION && place->part == y->part && !place->guided) {
                    add_term(&turning, place->mate, VALUE, i, VALUE);
                }
            }
            for (int j = 0; j < v->ncolumn; ++j) {
                if (v->share[i][j] > GAINS && v->column[j].kind != PM_LOGGER_POSITION) {
                    add_positions(v, &turning, y->part, j, VALUE, true);
                }
            }
            v->turns[i] = y->source != NULL && gain_of(w, i, &turning, 0, work, NULL) > GAINS;
            double rate = 0;
            int count = 0;
            const pm_dataset *d = v->dataset;
            for (int k = 0; k + 1 < w->nrow; ++k) {
                const double *row = w->value + (ptrdiff_t)k * PM_LOGGER_COLUMNS;
                const double step =
                    (row[PM_LOGGER_COLUMNS + i] - row[i]) / (w->time[k + 1] - w->time[k]);
                const bool inside = (k + 1) % d->ntime != 0 && isfinite(step);
                rate += inside ? step * step : 0;
                count += inside;
            }
            v->pushes[i] = fabs(y->constant) > PUSHES * sqrt(rate / (count > 0 ? count : 1));
        }
        // What flows may turn with an angle, or with an input.
        for (int j = 0; j < v->nvariable; ++j) {
            const pm_logger_column *other = &v->column[j];
            if (j == i || other->kind != PM_LOGGER_FLOW || other->part != y->part) {
                continue;
            }
            term_list crank = {0};
            add_known(v, &crank, i);
            const int known = crank.count;
            if (y->mate < 0 || other->mate < 0) {
                add_positions(v, &crank, y->part, j, VALUE, false);
            }
            v->crank[i][j] = gain_of(w, i, &crank, known, work, NULL) > GAINS;
            for (int u = v->nvariable; u < v->ncolumn; ++u) {
                // Each of the two moves the other. An inertia that they share lets a force on one
                // of them move the other one, too.
                bool one, both;
                if (i < j && !(v->inertial[y->part] && y->mate >= 0 && other->mate >= 0) &&
                    v->nconverter < PM_LOGGER_ACTIONS && converts(w, u, i, j, work, &one) &&
                    converts(w, u, j, i, work, &both)) {
                    const bool loses = one && both && v->column[u].least >= 0 &&
                                       pm_unit_equal(&y->dimension, &other->dimension);
                    v->converter[v->nconverter++] = (pm_logger_converter){u, i, j, loses, loses};
                }
            }
        }
        double most = -INFINITY;
        int warmest = -1; // the temperature of a neighbour that seems to be heated most
        for (int t = 0; t < v->nvariable; ++t) {
            if (v->column[t].kind == PM_LOGGER_TEMPERATURE &&
                pm_logger_meets(v, y->part, v->column[t].part)) {
                term_list heat = {0};
                double x[MOST] = {0}, gain[2], rest = 0; // of short and of long windows
                add_expansion(v, &heat, t);
                const int known = heat.count;
                add_term(&heat, i, SIZE, i, SIZE);
                // Heat is never taken back, so that long windows show it best.
                for (int k = 1; k >= 0; --k) {
                    heat.length = k == 1 ? v->dataset->ntime / LONG_WINDOWS : 0;
                    gain[k] = gain_of(w, t, &heat, known, work, x);
                    rest = k == 1 ? work->rest : rest;
                }
                const double rise = x[work->n - 1];
                // A loss heats the thermometer of its part even if little of it is seen there.
                const bool seen = rise > 0 && (gain[0] > GAINS || gain[1] > MOSTLY * rest);
                const bool hidden = y->source == NULL;
                if (copysign(gain[1], rise) > most) {
                    most = copysign(gain[1], rise);
                    warmest = t;
                }
                v->warms[i][t] = seen || ((rise > 0 || hidden) && t == v->thermometer[y->part]);
                // The power of the loss gives the scale of all capacities, or, where an input has
                // given that, of all other co-energies.
                const double size = fmax(fabs(y->least), fabs(y->largest));
                const double power = y->inertia * fmax(y->decay, 0) * size * size;
                const double scale = seen && power > 0 ? power / (rise * v->column[t].inertia) : 1;
                // One ratio joins both scales. A second one would take away their only unit.
                if (v->warms[i][t] && !v->joined && pm_logger_heat_is_free(v)) {
                    pm_logger_scale_heat(v, scale);
                } else if (v->warms[i][t] && !v->joined) {
                    pm_logger_scale_motion(v, 1 / scale);
                }
                v->joined = v->joined || v->warms[i][t];
            }
        }
        if (y->guess == PM_LOGGER_WARMER && warmest >= 0) {
            v->warms[i][warmest] = true;
        }
    }
    take_guesses(w, work);
    // What moves two co-energies through a throttle does not move each of them by itself.
    int kept = 0;
    for (int a = 0; a < v->naction; ++a) {
        const pm_logger_action *action = &v->action[a];
        const bool learned = action->effect == PM_LOGGER_GAIN ||
                             action->effect == PM_LOGGER_WARMS ||
                             (action->effect == PM_LOGGER_COOLS && action->enters == 0);
        bool throttled = false;
        for (int k = 0; k < v->nconverter && learned; ++k) {
            const pm_logger_converter *c = &v->converter[k];
            throttled = throttled || (c->alone && c->input == action->input &&
                                      (c->one == action->target || c->other == action->target));
        }
        if (!throttled) {
            v->action[kept++] = *action;
        }
    }
    v->naction = kept;
    offer_openings(w, work);
    return PM_OK;
}
