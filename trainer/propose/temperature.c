// Fits a polynomial energy to the power of motion, on both halves of the data.
#include "propose/temperature.h"

#include <math.h>
#include <string.h>

#define MOST_DEGREE 4   // of the polynomial: enough for the energies of springs and of heat
#define MOST_FACTORS 40 // terms of one subsystem
#define MOST_TERMS 160  // terms of all subsystems
#define BLOCKS 20       // of states, which belong to both halves in turn
#define UNEXPLAINED 0.3 // largest fraction of the squared power of the other half
#define AGREE 2.0       // largest ratio of the temperatures of both halves
_Static_assert(MOST_TERMS <= PM_MAX_TERMS, "least squares have room for all terms");

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
    int nterm;
    term term[MOST_TERMS];
    double size[MOST_TERMS];        // root mean squares of the rates of the terms
    double solution[2][MOST_TERMS]; // of the fits to both halves, for scaled terms
    pm_least_squares equations;
} energy_balance;

// Returns the product of the variables of a term but for number `without` in state k.
static double product_of(const energy_balance *b, const term *t, int without, int k) {
    const double *z = b->look->z + (ptrdiff_t)k * b->look->scene->physics.nz;
    double product = 1;
    for (int j = 0; j < t->degree; ++j) {
        const int c = t->component[j];
        product *= j == without ? 1 : (z[c] - b->mean[c]) / b->deviation[c];
    }
    return product;
}

// Returns the power of a term in state k: the rate of a part of U.
static double rate_of(const energy_balance *b, const term *t, int k) {
    const double *rate = b->look->rate + (ptrdiff_t)k * b->look->scene->physics.nz;
    if (t->moved >= 0) {
        return rate[t->moved] / b->deviation[t->moved] * product_of(b, t, -1, k);
    }
    double sum = 0;
    for (int i = 0; i < t->degree; ++i) {
        sum += rate[t->component[i]] / b->deviation[t->component[i]] * product_of(b, t, i, k);
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

// Adds the terms of one subsystem. Returns false if there is no room.
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
    bool added = add_polynomial(b, &none, MOST_DEGREE, MOST_FACTORS, &all);
    // The terms p p x' and their products with powers of the components x, which may be those of
    // dK/dx of a kinetic energy K that is quadratic in the momenta p.
    const double room = p.n > 0 ? 2.0 * MOST_FACTORS / (p.n * (p.n + 1) * x.n) - 1 : 0;
    for (int i = 0; i < x.n && added; ++i) {
        for (int k = 0; k < p.n * p.n && added; ++k) {
            const term mass = {x.at[i], 2, {p.at[k / p.n], p.at[k % p.n]}};
            if (k % p.n <= k / p.n) {
                added = add_products(b, &mass, 0, &x) &&
                        (room < x.n || add_polynomial(b, &mass, MOST_DEGREE, room, &x));
            }
        }
    }
    return added;
}

// Computes the units of all variables and terms. Momenta are not centred, since their energy is
// quadratic in them.
static void find_units(energy_balance *b) {
    const int nz = b->look->scene->physics.nz, count = b->look->count;
    for (int i = 0; i < b->look->scene->physics.nsubsystem; ++i) {
        const pm_part_view *v = &b->parts[i];
        for (int g = 0; g < v->count; ++g) {
            for (int c = v->group[g].first; c < v->group[g].first + v->group[g].group->size; ++c) {
                b->unit[c] =
                    v->kind[g] == PM_VIEW_ENTROPY && !v->group[g].constant ? v->unit[g].factor : 0;
                for (int k = 0; k < count && v->kind[g] != PM_VIEW_MOMENTUM; ++k) {
                    b->mean[c] += b->look->z[(ptrdiff_t)k * nz + c] / count;
                }
                for (int k = 0; k < count; ++k) {
                    const double x = b->look->z[(ptrdiff_t)k * nz + c] - b->mean[c];
                    b->deviation[c] += x * x / count;
                }
                b->deviation[c] = b->deviation[c] > 0 ? sqrt(b->deviation[c]) : 1;
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

// Fits one half of the states, 0 or 1, and returns the fraction of the squared power of the other
// half that the fit does not explain. The states are in the order of trajectories, which may be
// sorted by their size; therefore the halves consist of blocks.
static double fit(energy_balance *b, int half) {
    const int n = b->nterm, count = b->look->count;
    double rest = 0, square = 0;
    b->equations = (pm_least_squares){.n = n};
    for (int pass = 0; pass < 2; ++pass) {
        for (int k = 0; k < count; ++k) {
            if ((int)((long)k * BLOCKS / count % 2) != (pass == 0 ? half : 1 - half)) {
                continue;
            }
            // The power of motion, in W.
            const double *rate = b->look->rate + (ptrdiff_t)k * b->look->scene->physics.nz;
            double power = 0;
            for (int i = 0; i < b->look->scene->physics.nsubsystem; ++i) {
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
            double x[MOST_TERMS], sum = power;
            for (int a = 0; a < n; ++a) {
                x[a] = rate_of(b, &b->term[a], k) / b->size[a];
                sum += b->solution[half][a] * x[a];
            }
            if (pass == 0) {
                pm_least_squares_add(&b->equations, x, -power);
            } else {
                rest += sum * sum;
                square += power * power;
            }
        }
        if (pass == 0) {
            (void)pm_least_squares_solve(&b->equations, b->solution[half]);
        }
    }
    return square > 0 ? rest / square : 1;
}

// Returns the geometric mean of two temperatures if they are positive and alike, else 0.
static double agree(double a, double b) {
    return a > 0 && b > 0 && fmax(a, b) < AGREE * fmin(a, b) ? sqrt(a * b) : 0;
}

void pm_look_temperatures(const pm_look *look, const pm_part_view *parts, double *temperature) {
    const pm_scene *scene = look->scene;
    const size_t nz = (size_t)scene->physics.nz;
    pm_arena arena = {0};
    energy_balance *b = pm_arena_array(&arena, 1, sizeof *b);
    double *work = pm_arena_array(&arena, 3 * nz, sizeof *work);
    memset(temperature, 0, nz * sizeof *temperature);
    bool known = !arena.failed && scene->physics.nboundary_input == 0;
    if (known) {
        b->look = look;
        b->parts = parts;
        b->mean = work;
        b->deviation = work + nz;
        b->unit = work + 2 * nz;
    }
    for (int i = 0; i < scene->physics.nsubsystem && known; ++i) {
        known = add_part(b, &parts[i]);
    }
    if (known && b->nterm > 0) {
        find_units(b);
        known = fmax(fit(b, 0), fit(b, 1)) < UNEXPLAINED;
    }
    // The temperatures of both halves; their mean counts each by the entropy that moves.
    double sum[2] = {0}, weight = 0;
    for (size_t c = 0; c < nz && known && b->nterm > 0; ++c) {
        double square = 0, slope[2] = {0};
        for (int k = 0; k < look->count; ++k) {
            const double rate = look->rate[(size_t)k * nz + c] * b->unit[c];
            square += rate * rate;
        }
        weight += sqrt(square);
        for (int half = 0; half < 2 && b->unit[c] > 0; ++half) {
            for (int a = 0; a < b->nterm; ++a) { // the mean of dU/ds over all states, in K
                const term *u = &b->term[a];
                double sum_of_term = 0;
                for (int i = 0; i < u->degree && u->moved < 0; ++i) {
                    for (int k = 0; k < look->count && u->component[i] == (int)c; ++k) {
                        sum_of_term += product_of(b, u, i, k);
                    }
                }
                slope[half] += b->solution[half][a] / b->size[a] * sum_of_term;
            }
            slope[half] /= look->count * b->deviation[c] * b->unit[c];
            sum[half] += sqrt(square) * slope[half];
        }
        temperature[c] = agree(slope[0], slope[1]);
    }
    const double common = weight > 0 ? agree(sum[0] / weight, sum[1] / weight) : 0;
    for (size_t c = 0; c < nz && known && b->nterm > 0; ++c) {
        const double own = temperature[c] > 0 ? temperature[c] : common;
        temperature[c] = common > 0 && b->unit[c] > 0 ? own : 0;
    }
    pm_arena_free(&arena);
}
