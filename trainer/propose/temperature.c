// Fits a polynomial energy to the power of motion, by normal equations on both halves of the data.
#include "propose/temperature.h"

#include <math.h>
#include <string.h>

#include "base/linalg.h"

#define MOST_DEGREE 4   // of the polynomial
#define MOST_FACTORS 40 // terms of one subsystem
#define MOST_TERMS 160  // terms of all subsystems
#define RIDGE 1e-10     // relative to the diagonal
#define UNEXPLAINED 0.3 // largest fraction of the squared power of the other half
#define AGREE 2.0       // largest ratio of the temperatures of both halves

// A product of powers of centred and scaled variables of one subsystem.
typedef struct term {
    int degree;
    int component[MOST_DEGREE]; // [degree] positions in the state of the scene, ascending
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

// Whether the momentum of this pair moves the position alone, so that x' p' is its kinetic power.
static bool is_known(const pm_part_view *v, int position) {
    return v->kind[position] == PM_VIEW_POSITION && v->apart[position];
}

// Returns the power of motion in state k, in W.
static double power_of(const energy_balance *b, int k) {
    const double *rate = b->look->rate + (ptrdiff_t)k * b->look->scene->nz;
    double power = 0;
    for (int i = 0; i < b->look->scene->nsubsystem; ++i) {
        const pm_part_view *v = &b->parts[i];
        for (int g = 0; g < v->count; ++g) {
            const int m = v->mate[g];
            for (int c = 0; is_known(v, g) && c < v->group[g].group->size; ++c) {
                power += v->sign[g] * v->unit[g].factor * v->unit[m].factor *
                         rate[v->group[g].first + c] * rate[v->group[m].first + c];
            }
        }
    }
    return power;
}

// Returns the rate of a term in state k.
static double rate_of(const energy_balance *b, const term *t, int k) {
    const double *z = b->look->z + (ptrdiff_t)k * b->look->scene->nz;
    const double *rate = b->look->rate + (ptrdiff_t)k * b->look->scene->nz;
    double sum = 0;
    for (int i = 0; i < t->degree; ++i) {
        double product = rate[t->component[i]] / b->deviation[t->component[i]];
        for (int j = 0; j < t->degree; ++j) {
            const int c = t->component[j];
            product *= j == i ? 1 : (z[c] - b->mean[c]) / b->deviation[c];
        }
        sum += product;
    }
    return sum;
}

// Returns the derivative of a term by the scaled component c in state k.
static double slope_of(const energy_balance *b, const term *t, int c, int k) {
    const double *z = b->look->z + (ptrdiff_t)k * b->look->scene->nz;
    double sum = 0;
    for (int i = 0; i < t->degree; ++i) {
        double product = t->component[i] == c;
        for (int j = 0; j < t->degree; ++j) {
            const int d = t->component[j];
            product *= j == i ? 1 : (z[d] - b->mean[d]) / b->deviation[d];
        }
        sum += product;
    }
    return sum;
}

// --- the terms ---

// Writes the components of a subsystem that change, but for momenta whose energy is known. Returns
// their number.
static int list_components(const pm_part_view *v, int most, int *component) {
    int n = 0;
    for (int g = 0; g < v->count; ++g) {
        const bool known = v->kind[g] == PM_VIEW_MOMENTUM && is_known(v, v->mate[g]);
        for (int c = 0; c < v->group[g].group->size && !known && !v->group[g].constant; ++c) {
            if (n < most) {
                component[n] = v->group[g].first + c;
            }
            ++n;
        }
    }
    return n;
}

// Adds all products of `degree` of n components to the terms. Returns false if there is no room.
static bool add_products(energy_balance *b, int degree, int n, const int *component) {
    int choice[MOST_DEGREE] = {0};
    for (int last = 0; last >= 0;) {
        if (b->nterm == MOST_TERMS) {
            return false;
        }
        term *t = &b->term[b->nterm++];
        t->degree = degree;
        for (int i = 0; i < degree; ++i) {
            t->component[i] = component[choice[i]];
        }
        for (last = degree - 1; last >= 0 && choice[last] == n - 1; --last) {
        }
        for (int i = degree - 1; i >= last && last >= 0; --i) {
            choice[i] = choice[last] + 1;
        }
    }
    return true;
}

// Lists the products of one subsystem up to the highest degree for which there are few.
static bool add_part(energy_balance *b, const pm_part_view *v) {
    int component[MOST_FACTORS];
    const int n = list_components(v, MOST_FACTORS, component);
    double count = 1;
    for (int degree = 1; degree <= MOST_DEGREE && n > 0; ++degree) {
        count *= (double)(n + degree) / degree; // binomial coefficient: products up to this degree
        if (count - 1 > MOST_FACTORS) {
            return degree > 1;
        }
        if (!add_products(b, degree, n, component)) {
            return false;
        }
    }
    return true;
}

static void find_units(energy_balance *b) {
    const int nz = b->look->scene->nz, count = b->look->count;
    for (int c = 0; c < nz; ++c) {
        for (int k = 0; k < count; ++k) {
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
    for (int k = half * (count / 2); k < (half == 0 ? count / 2 : count); ++k) {
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
    const int count = b->look->count, other = 1 - half;
    double x[MOST_TERMS], rest = 0, square = 0;
    for (int k = other * (count / 2); k < (other == 0 ? count / 2 : count); ++k) {
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
