// Solves the normal equations of multiple shooting. Starts x_w of neighbouring windows are coupled
// by their gap, and all with the weights theta:
//
//     [ H_1  C_1            B_1 ]      H_w  starts of window w, with its own gap and that before
//     [ C_1' H_2  C_2       B_2 ]      C_w  = -(d end_w / d x_w)' / gap^2
//     [      C_2' ...       ... ]      B_w  starts with weights
//     [ B_1' B_2' ...        T  ]      T    weights
//
// The starts are eliminated from the first window on, by a block Cholesky factorisation whose last
// block is the Schur complement on the weights. Cost and memory grow linearly with the windows.
#include <math.h>
#include <string.h>

#include "base/linalg.h"
#include "learn/shooting.h"

// The least diagonal in relation to the largest, for unknowns on which nothing depends.
#define LEAST_DIAGONAL 1e-12
#define LEAST_WEIGHT 1e-10

// Adds what the gap before a window says about its start: the start enters this gap with -1/gap.
static void add_gap_before(const pm_shooting *s, int window, double *own, double *border) {
    const ptrdiff_t nz = s->nz, nb = s->nborder;
    const double *rows = s->end_by_weights + (window - 1) * nz * nb;
    for (ptrdiff_t i = 0; i < nz; ++i) {
        own[i * (nz + 1)] += 1 / (s->gap[i] * s->gap[i]);
        for (ptrdiff_t k = 0; k < nb; ++k) {
            border[i * nb + k] -= rows[i * nb + k] / s->gap[i];
        }
    }
}

// Subtracts what elimination of the window before leaves: its solved blocks X_C'[X_C X_B].
static void subtract_before(const pm_shooting *s, int window, double *own, double *border) {
    const ptrdiff_t nz = s->nz, nb = s->nborder;
    const double *c = s->coupling + (window - 1) * nz * nz;
    const double *b = s->solved + (window - 1) * nz * nb;
    for (ptrdiff_t l = 0; l < nz; ++l) {
        for (ptrdiff_t i = 0; i < nz; ++i) {
            const double factor = c[l * nz + i];
            for (ptrdiff_t k = 0; k < nz; ++k) {
                own[i * nz + k] -= factor * c[l * nz + k];
            }
            for (ptrdiff_t k = 0; k < nb; ++k) {
                border[i * nb + k] -= factor * b[l * nb + k];
            }
        }
    }
}

// Solves u' x = b for `count` right-hand sides, b [n][count].
static void forward(int n, const double *u, int count, double *b) {
    for (ptrdiff_t i = 0; i < n; ++i) {
        for (ptrdiff_t l = 0; l < i; ++l) {
            const double factor = u[l * n + i];
            for (ptrdiff_t k = 0; k < count; ++k) {
                b[i * count + k] -= factor * b[l * count + k];
            }
        }
        const double scale = 1 / u[i * n + i];
        for (ptrdiff_t k = 0; k < count; ++k) {
            b[i * count + k] *= scale;
        }
    }
}

static void damp(int n, double damping, double *matrix, double least) {
    double largest = 0;
    for (ptrdiff_t i = 0; i < n; ++i) {
        largest = fmax(largest, matrix[i * (n + 1)]);
    }
    for (ptrdiff_t i = 0; i < n; ++i) {
        matrix[i * (n + 1)] += damping * matrix[i * (n + 1)] + least * largest;
    }
}

// Factorises the block of one window and solves for its couplings.
static bool eliminate(pm_shooting *s, int window, double damping) {
    const ptrdiff_t nz = s->nz, nb = s->nborder;
    double *u = s->factor + window * nz * nz, *c = s->coupling + window * nz * nz;
    double *b = s->solved + window * nz * nb;
    memcpy(u, s->own + window * nz * nz, (size_t)(nz * nz) * sizeof *u);
    memcpy(b, s->border + window * nz * nb, (size_t)(nz * nb) * sizeof *b);
    const bool follows = s->window[window].follows;
    if (follows) {
        add_gap_before(s, window, u, b);
    }
    damp(s->nz, damping, u, LEAST_DIAGONAL);
    if (follows) {
        subtract_before(s, window, u, b);
    }
    if (!pm_cholesky_factor(s->nz, u)) {
        return false;
    }
    if (!s->window[window].ends) {
        const double *by_start = s->end_by_start + window * nz * nz;
        for (ptrdiff_t i = 0; i < nz; ++i) {
            for (ptrdiff_t k = 0; k < nz; ++k) {
                c[i * nz + k] = -by_start[k * nz + i] / s->gap[k];
            }
        }
        forward(s->nz, u, s->nz, c);
    }
    forward(s->nz, u, s->nborder, b);
    return true;
}

// Adds the gaps' rows of weights, which the matrix holds already, and forms the Schur complement.
static bool solve_weights(pm_shooting *s, double damping, double *weights) {
    const ptrdiff_t nb = s->nborder, n = s->nweight;
    memset(s->reduced, 0, (size_t)(nb * nb) * sizeof *s->reduced);
    pm_gram_add(s->nwindow * s->nz, s->nborder, s->solved, s->reduced);
    double largest = 0;
    for (ptrdiff_t i = 0; i < n; ++i) {
        largest = fmax(largest, s->matrix[i * (nb + 1)]);
    }
    double *h = s->reduced;
    for (ptrdiff_t i = 0; i < n; ++i) {
        for (ptrdiff_t k = i; k < nb; ++k) {
            h[i * nb + k] = s->matrix[i * nb + k] - h[i * nb + k];
        }
        h[i * (nb + 1)] +=
            damping * s->matrix[i * (nb + 1)] + LEAST_WEIGHT * damping * largest + 1e-14 * largest;
        weights[i] = -h[i * nb + n];
    }
    // Closes the gap of the last column, so that the rest is a contiguous matrix of the weights.
    for (ptrdiff_t i = 1; i < n; ++i) {
        memmove(h + i * n, h + i * nb, (size_t)n * sizeof *h);
    }
    return n == 0 || pm_cholesky_solve((int)n, h, weights);
}

// Computes the steps of the starts of one track from its last window back.
static void substitute(const pm_shooting *s, int window, const double *weights, double *z) {
    const ptrdiff_t nz = s->nz, nb = s->nborder;
    const double *u = s->factor + window * nz * nz, *c = s->coupling + window * nz * nz;
    const double *b = s->solved + window * nz * nb;
    for (ptrdiff_t i = 0; i < nz; ++i) {
        double sum = -b[i * nb + s->nweight];
        for (ptrdiff_t k = 0; k < s->nweight; ++k) {
            sum -= b[i * nb + k] * weights[k];
        }
        for (ptrdiff_t k = 0; k < nz && !s->window[window].ends; ++k) {
            sum -= c[i * nz + k] * z[(window + 1) * nz + k];
        }
        z[window * nz + i] = sum;
    }
    for (ptrdiff_t i = nz - 1; i >= 0; --i) {
        double sum = z[window * nz + i];
        for (ptrdiff_t k = i + 1; k < nz; ++k) {
            sum -= u[i * nz + k] * z[window * nz + k];
        }
        z[window * nz + i] = sum / u[i * (nz + 1)];
    }
}

bool pm_shooting_solve(pm_shooting *s, double damping, double *weights, double *z) {
    for (int w = 0; w < s->nwindow; ++w) {
        if (!eliminate(s, w, damping)) {
            return false;
        }
    }
    if (s->hold) {
        memset(weights, 0, (size_t)s->nweight * sizeof *weights);
    } else if (!solve_weights(s, damping, weights)) {
        return false;
    }
    for (int w = s->nwindow - 1; w >= 0; --w) {
        substitute(s, w, weights, z);
    }
    return true;
}
