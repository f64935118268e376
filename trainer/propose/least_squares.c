// Normal equations with a small ridge, solved by Cholesky's method.
#include "propose/least_squares.h"

#include <math.h>
#include <string.h>

#include "base/linalg.h"

#define RIDGE 1e-10 // relative to the diagonal, for terms that depend on each other linearly

void pm_least_squares_add(pm_least_squares *s, const double *x, double y) {
    for (int a = 0; a < s->n; ++a) {
        s->right[a] += x[a] * y;
        for (int b = 0; b < s->n; ++b) {
            s->matrix[a * s->n + b] += x[a] * x[b];
        }
    }
    s->square += y * y;
}

double pm_least_squares_solve(pm_least_squares *s, double *solution) {
    for (int a = 0; a < s->n; ++a) {
        s->matrix[a * s->n + a] = s->matrix[a * s->n + a] * (1 + RIDGE) + 1e-300;
        solution[a] = s->right[a];
    }
    if (s->square == 0 || s->n == 0 || !pm_cholesky_solve(s->n, s->matrix, solution)) {
        memset(solution, 0, sizeof(double) * (size_t)s->n);
        return 1;
    }
    double explained = 0;
    for (int a = 0; a < s->n; ++a) {
        explained += solution[a] * s->right[a];
    }
    return fmax(1 - explained / s->square, 0);
}
