// Fits a polynomial energy to the power of motion, by normal equations on both halves of the data.
#include "propose/temperature.h"

#include <math.h>
#include <string.h>

#include "base/linalg.h"

#define MOST_DEGREE 4   // of the polynomial
#define MOST_FACTORS 40 // terms of one subsystem
#define MOST_TERMS 160  // terms of all subsystems
#define BLOCKS 20       // of states, which belong to both halves in turn
#define RIDGE 1e-10     // relative to the diagonal
#define UNEXPLAINED 0.3 // largest fraction of the squared power of the other half
#define AGREE 2.0       // largest ratio of the temperatures of both halves

// A product of scaled variables of one subsystem. It is a part of U, or, with `moved`, the factor
// of the rate of this component in the power of a mass that depends on positions.
typedef struct term {
    int moved; // position in the state of the scene; -1: a part of U
    int degree;
    int component[2 + MOST_DEGREE]; // [degree] positions in the state of the scene
} term;

typedef struct energy_balance {
    const pm_look *look;
    const pm_part_view *parts;
    double *mean, *deviation; // [nz]
    double *unit;             // [nz] J/K per unit of an entropy, 0: no entropy
    double *slope;            // [2][nz] dU/ds of the fit to each half, in K
    int nterm;
    term term[MOST_TERMS];
    double *matrix;                 // [nterm][nterm]
    double solution[2][MOST_TERMS]; // of both halves, for scaled terms
    double size[MOST_TERMS];        // root mean squares of the rates of the terms
} energy_balance;

// Returns the power of motion in state k, in W.
static double power_of(const energy_balance *b, int k) {
    const double *rate = b->look->rate + (ptrdiff_t)k * b->look->scene->nz;
    double power = 0;
    for (int i = 0; i < b->look->scene->nsubsystem; ++i) {
        const pm_part_view *v = &b->parts[i];
        for (int g = 0; g < v->count; ++g) {
            const int m = v->mate[g];
            const int size = v->kind[g] == PM_VIEW_POSITION ? v->group[g].group->size : 0;
            for (int c = 0; c < size; ++c) {
                power += v->sign[g] * v->unit[g].factor * v->unit[m].factor *
                         rate[v->group[g].first + c] * rate[v->group[m].first + c];
            }
        }
    }
    return power;
}

// Returns the product of the variables of a term but for number `without` in state k.
static double product_of(const energy_balance *b, const term *t, int without, int k) {
    const double *z = b->look->z + (ptrdiff_t)k * b->look->scene->nz;
    double product = 1;
    for (int j = 0; j < t->degree; ++j) {
        const int c = t->component[j];
        product *= j == without ? 1 : (z[c] - b->mean[c]) / b->deviation[c];
    }
    return product;
}

// Returns the power of a term in state k: the rate of a part of U.
static double rate_of(const energy_balance *b, const term *t, int k) {
    const double *rate = b->look->rate + (ptrdiff_t)k * b->look->scene->nz;
    if (t->moved >= 0) {
        return rate[t->moved] / b->deviation[t->moved] * product_of(b, t, -1, k);
    }
    double sum = 0;
    for (int i = 0; i < t->degree; ++i) {
        sum += rate[t->component[i]] / b->deviation[t->component[i]] * product_of(b, t, i, k);
    }
    return sum;
}

// Returns the derivative of a term of U by the scaled component c in state k.
static double slope_of(const energy_balance *b, const term *t, int c, int k) {
    double sum = 0;
    for (int i = 0; i < t->degree && t->moved < 0; ++i) {
        sum += t->component[i] == c ? product_of(b, t, i, k) : 0;
    }
    return sum;
}

// --- the terms ---

// Components of the variables of one subsystem that change.
typedef struct components {
    int n;
    int at[MOST_FACTORS + 1]; // positions in the state of the scene
} components;

static void add_components(components *list, const pm_look_group *g) {
    for (int c = 0; c < g->group->size && !g->constant && list->n <= MOST_FACTORS; ++c) {
        list->at[list->n++] = g->first + c;
    }
}

// Adds all products of `degree` of the components, times the components of `before`, to the terms.
// Returns false if there is no room.
static bool add_products(energy_balance *b, const term *before, int degree,
                         const components *list) {
    int choice[MOST_DEGREE] = {0};
    for (int last = 0; last >= 0;) {
        if (b->nterm == MOST_TERMS) {
            return false;
        }
        term *t = &b->term[b->nterm++];
        *t = *before;
        for (int i = 0; i < degree; ++i) {
            t->component[t->degree++] = list->at[choice[i]];
        }
        for (last = degree - 1; last >= 0 && choice[last] == list->n - 1; --last) {
        }
        for (int i = degree - 1; i >= last && last >= 0; --i) {
            choice[i] = choice[last] + 1;
        }
    }
    return true;
}

// Adds all products up to the highest degree, at most `most`, for which there are at most `room`.
// Returns false if there is no room for the first degree.
static bool add_polynomial(energy_balance *b, const term *before, int most, double room,
                           const components *list) {
    double count = 1;
    for (int degree = 1; degree <= most && list->n > 0; ++degree) {
        count *= (double)(list->n + degree) / degree; // products up to this degree, and 1
        if (count - 1 > room) {
            return degree > 1;
        }
        if (!add_products(b, before, degree, list)) {
            return false;
        }
    }
    return true;
}

// Adds the terms p p x' and their products with powers of the components x, which may be those
// of dK/dx of a kinetic energy K that is quadratic in the momenta p.
static bool add_masses(energy_balance *b, const components *x, const components *p) {
    const double room = p->n > 0 ? 2.0 * MOST_FACTORS / (p->n * (p->n + 1) * x->n) - 1 : 0;
    bool added = true;
    for (int i = 0; i < x->n && added; ++i) {
        for (int k = 0; k < p->n * p->n && added; ++k) {
            const term mass = {x->at[i], 2, {p->at[k / p->n], p->at[k % p->n]}};
            if (k % p->n <= k / p->n) {
                added = add_products(b, &mass, 0, x) &&
                        (room < x->n || add_polynomial(b, &mass, MOST_DEGREE, room, x));
            }
        }
    }
    return added;
}

static bool add_part(energy_balance *b, const pm_part_view *v) {
    components all = {0}, x = {0}, p = {0};
    for (int g = 0; g < v->count; ++g) {
        if (v->kind[g] != PM_VIEW_MOMENTUM) {
            add_components(&all, &v->group[g]);
        } else if (!v->apart[v->mate[g]]) {
            add_components(&p, &v->group[g]);
        }
        if (v->kind[g] != PM_VIEW_MOMENTUM && v->kind[g] != PM_VIEW_ENTROPY) {
            add_components(&x, &v->group[g]);
        }
    }
    const term none = {.moved = -1};
    return add_polynomial(b, &none, MOST_DEGREE, MOST_FACTORS, &all) && add_masses(b, &x, &p);
}

// Returns true for momenta, which are not centred, since their energy is quadratic in them.
static bool is_momentum(const energy_balance *b, int c) {
    for (int i = 0; i < b->look->scene->nsubsystem; ++i) {
        const pm_part_view *v = &b->parts[i];
        for (int g = 0; g < v->count; ++g) {
            if (v->kind[g] == PM_VIEW_MOMENTUM && c >= v->group[g].first &&
                c < v->group[g].first + v->group[g].group->size) {
                return true;
            }
        }
    }
    return false;
}

static void find_units(energy_balance *b) {
    const int nz = b->look->scene->nz, count = b->look->count;
    for (int c = 0; c < nz; ++c) {
        for (int k = 0; k < count && !is_momentum(b, c); ++k) {
            b->mean[c] += b->look->z[(ptrdiff_t)k * nz + c] / count;
        }
        for (int k = 0; k < count; ++k) {
            const double x = b->look->z[(ptrdiff_t)k * nz + c] - b->mean[c];
            b->deviation[c] += x * x / count;
        }
        b->deviation[c] = b->deviation[c] > 0 ? sqrt(b->deviation[c]) : 1;
    }
    for (int i = 0; i < b->look->scene->nsubsystem; ++i) {
        const pm_part_view *v = &b->parts[i];
        for (int g = 0; g < v->count; ++g) {
            for (int c = 0; c < v->group[g].group->size; ++c) {
                b->unit[v->group[g].first + c] =
                    v->kind[g] == PM_VIEW_ENTROPY && !v->group[g].constant ? v->unit[g].factor : 0;
            }
        }
    }
    for (int a = 0; a < b->nterm; ++a) {
        for (int k = 0; k < count; ++k) {
            const double x = rate_of(b, &b->term[a], k);
            b->size[a] += x * x / count;
        }
        b->size[a] = b->size[a] > 0 ? sqrt(b->size[a]) : 1;
    }
}

// --- the fits ---

// Returns the half that state k belongs to, 0 or 1. The states are in the order of trajectories,
// which may be sorted by their size.
static int half_of(const energy_balance *b, int k) {
    return (int)((long)k * BLOCKS / b->look->count % 2);
}

// Writes the rates of the scaled terms in state k to x [nterm].
static void write_row(const energy_balance *b, int k, double *x) {
    for (int a = 0; a < b->nterm; ++a) {
        x[a] = rate_of(b, &b->term[a], k) / b->size[a];
    }
}

// Fits one half of the states: 0 or 1.
static bool fit(energy_balance *b, int half) {
    const int n = b->nterm, count = b->look->count;
    double x[MOST_TERMS], *solution = b->solution[half];
    memset(b->matrix, 0, (size_t)n * (size_t)n * sizeof *b->matrix);
    for (int k = 0; k < count; ++k) {
        if (half_of(b, k) != half) {
            continue;
        }
        const double power = power_of(b, k);
        write_row(b, k, x);
        pm_gram_add(1, n, x, b->matrix);
        for (int a = 0; a < n; ++a) {
            solution[a] -= x[a] * power;
        }
    }
    for (int a = 0; a < n; ++a) {
        b->matrix[a * n + a] = b->matrix[a * n + a] * (1 + RIDGE) + 1e-300;
    }
    return pm_cholesky_solve(n, b->matrix, solution);
}

// Returns the fraction of the squared power of the other half that the fit does not explain.
static double unexplained(const energy_balance *b, int half) {
    const int count = b->look->count;
    double x[MOST_TERMS], rest = 0, square = 0;
    for (int k = 0; k < count; ++k) {
        if (half_of(b, k) == half) {
            continue;
        }
        const double power = power_of(b, k);
        double sum = power;
        write_row(b, k, x);
        for (int a = 0; a < b->nterm; ++a) {
            sum += b->solution[half][a] * x[a];
        }
        rest += sum * sum;
        square += power * power;
    }
    return square > 0 ? rest / square : 1;
}

// Returns the mean of dU/ds over all states, in K.
static double mean_slope(const energy_balance *b, int half, int c) {
    double sum = 0;
    for (int a = 0; a < b->nterm; ++a) {
        for (int k = 0; k < b->look->count; ++k) {
            sum += b->solution[half][a] / b->size[a] * slope_of(b, &b->term[a], c, k);
        }
    }
    return sum / b->look->count / b->deviation[c] / b->unit[c];
}

// Returns the geometric mean of two temperatures if they are positive and alike, else 0.
static double agree(double a, double b) {
    return a > 0 && b > 0 && fmax(a, b) < AGREE * fmin(a, b) ? sqrt(a * b) : 0;
}

// Writes the temperatures, of which the mean counts each by the entropy that moves.
static void write_temperatures(const energy_balance *b, double *temperature) {
    const int nz = b->look->scene->nz;
    double sum[2] = {0}, weight = 0;
    for (int c = 0; c < nz; ++c) {
        double square = 0;
        for (int k = 0; k < b->look->count; ++k) {
            const double rate = b->look->rate[(ptrdiff_t)k * nz + c] * b->unit[c];
            square += rate * rate;
        }
        weight += sqrt(square);
        for (int half = 0; half < 2 && b->unit[c] > 0; ++half) {
            b->slope[half * nz + c] = mean_slope(b, half, c);
            sum[half] += sqrt(square) * b->slope[half * nz + c];
        }
    }
    const double common = weight > 0 ? agree(sum[0] / weight, sum[1] / weight) : 0;
    for (int c = 0; c < nz && common > 0; ++c) {
        const double own = agree(b->slope[c], b->slope[nz + c]);
        temperature[c] = b->unit[c] > 0 ? (own > 0 ? own : common) : 0;
    }
}

void pm_look_temperatures(const pm_look *look, const pm_part_view *parts, double *temperature) {
    const pm_scene *scene = look->scene;
    const size_t nz = (size_t)scene->nz;
    pm_arena arena = {0};
    energy_balance *b = pm_arena_array(&arena, 1, sizeof *b);
    double *work = pm_arena_array(&arena, 5 * nz + MOST_TERMS * MOST_TERMS, sizeof *work);
    memset(temperature, 0, nz * sizeof *temperature);
    bool known = b != NULL && work != NULL && scene->nboundary_input == 0;
    if (known) {
        *b = (energy_balance){.look = look, .parts = parts, .mean = work, .deviation = work + nz};
        b->unit = work + 2 * nz;
        b->slope = work + 3 * nz;
        b->matrix = work + 5 * nz;
    }
    for (int i = 0; i < scene->nsubsystem && known; ++i) {
        known = add_part(b, &parts[i]);
    }
    if (known && b->nterm > 0) {
        find_units(b);
        if (fit(b, 0) && fit(b, 1) && fmax(unexplained(b, 0), unexplained(b, 1)) < UNEXPLAINED) {
            write_temperatures(b, temperature);
        }
    }
    pm_arena_free(&arena);
}
