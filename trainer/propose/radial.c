// Compares two regressions of the virial p' . q = -|q| dE/d|q|, with E a polynomial of |q| or
// ln|q|.
#include "propose/radial.h"

#include <math.h>

#include "propose/least_squares.h"

#define CLEARLY 0.5 // unexplained part of the better polynomial over that of the other
#define DEGREE 4    // of the energy
#define MOST_ENTROPIES 4
#define MOST_INPUTS 16

typedef struct virial {
    const pm_look *look;
    const pm_look_group *q, *p, *entropy;
    int nentropy; // at most MOST_ENTROPIES, the first components
    int ninput;
    int input[MOST_INPUTS][3];
    bool logarithm;
    double mean, deviation; // of |q| or ln|q|
} virial;

static double dot(int n, const double *a, const double *b) {
    double sum = 0;
    for (int c = 0; c < n; ++c) {
        sum += a[c] * b[c];
    }
    return sum;
}

// Returns |q| or ln|q| in examined state k.
static double argument(const virial *v, int k) {
    const double *q = v->look->z + (ptrdiff_t)k * v->look->scene->nz + v->q->first;
    const double square = dot(v->q->group->size, q, q);
    return v->logarithm ? 0.5 * log(square + 1e-300) : sqrt(square);
}

static void find_deviation(virial *v) {
    double square = 0;
    v->mean = 0;
    for (int k = 0; k < v->look->count; ++k) {
        v->mean += argument(v, k) / v->look->count;
    }
    for (int k = 0; k < v->look->count; ++k) {
        const double x = argument(v, k) - v->mean;
        square += x * x / v->look->count;
    }
    v->deviation = square > 0 ? sqrt(square) : 1;
}

// Writes the terms of examined state k and returns their number.
static int write_terms(const virial *v, int k, double *term) {
    const double *z = v->look->z + (ptrdiff_t)k * v->look->scene->nz, *q = z + v->q->first;
    const int size = v->q->group->size;
    const double x = (argument(v, k) - v->mean) / v->deviation;
    double slope = v->logarithm ? 1 : sqrt(dot(size, q, q)); // |q| dx/d|q|, but for a factor
    int n = 0;
    for (int degree = 0; degree < DEGREE; ++degree) {
        term[n++] = slope;
        for (int i = 0; i < v->nentropy && degree < 2; ++i) {
            term[n++] = slope * z[v->entropy[i].first];
        }
        slope *= x;
    }
    term[n++] = dot(size, z + v->p->first, q);
    for (int i = 0; i < v->ninput; ++i) {
        const pm_inputs *inputs = v->look->inputs;
        const double *value = inputs->value + (ptrdiff_t)k * inputs->input.n;
        term[n] = 0;
        for (int c = 0; c < size; ++c) {
            term[n] += value[v->input[i][c]] * q[c];
        }
        ++n;
    }
    return n;
}

// Returns the fraction of the squares of the virial that the regression leaves.
static double explain(virial *v, bool logarithm) {
    pm_least_squares s = {0};
    double term[PM_MAX_TERMS], solution[PM_MAX_TERMS];
    v->logarithm = logarithm;
    find_deviation(v);
    for (int k = 0; k < v->look->count; ++k) {
        const ptrdiff_t row = (ptrdiff_t)k * v->look->scene->nz;
        s.n = write_terms(v, k, term);
        pm_least_squares_add(&s, term,
                             dot(v->q->group->size, v->look->rate + row + v->p->first,
                                 v->look->z + row + v->q->first));
    }
    return pm_least_squares_solve(&s, solution);
}

bool pm_look_prefers_length(const pm_look *look, const pm_look_group *q, const pm_look_group *p,
                            int count, const pm_look_group *entropy) {
    virial v = {.look = look, .q = q, .p = p, .entropy = entropy};
    v.nentropy = count < MOST_ENTROPIES ? count : MOST_ENTROPIES;
    v.ninput = pm_inputs_vectors(look->inputs, pm_look_subsystem(look, q->first), q->group->size,
                                 MOST_INPUTS, v.input);
    const double with_logarithm = explain(&v, true);
    return explain(&v, false) < CLEARLY * with_logarithm;
}
