// Computes the rates of the membrane by formulas written out by hand, in two passes over the cells.
#include "membrane.h"

#include <math.h>
#include <stddef.h>

static double temperature(const membrane *w, const double *cell) {
    return w->Tr * exp((cell[MEMBRANE_S] - w->b * (cell[MEMBRANE_X] + cell[MEMBRANE_Y])) / w->c);
}

// Computes the temperatures, and how the energy of a cell changes with each elongation.
static void expose(const membrane *w, const double *z) {
    const int cells = w->side * w->side;
    for (int i = 0; i < cells; ++i) {
        const double *cell = z + (ptrdiff_t)MEMBRANE_NZ * i;
        const double x = cell[MEMBRANE_X], y = cell[MEMBRANE_Y], T = temperature(w, cell);
        const double thermal = w->b * (w->Tr - T);
        w->work[i] = T;
        w->work[cells + i] = w->k * x + w->n * x * x * x + thermal;
        w->work[2 * cells + i] = w->k * y + w->n * y * y * y + thermal;
    }
}

void membrane_rate(const void *data, const double *z, double *zdot) {
    const membrane *w = data;
    const int side = w->side, cells = side * side;
    const double *T = w->work, *fx = T + cells, *fy = fx + cells;
    expose(w, z);
    for (int c = 0; c < cells; ++c) {
        const double *cell = z + (ptrdiff_t)MEMBRANE_NZ * c;
        double *rate = zdot + (ptrdiff_t)MEMBRANE_NZ * c;
        const int i = c / side, j = c % side;
        const double v = cell[MEMBRANE_P] / w->m;
        double force = -fx[c] - fy[c] - w->mu * v, warmer = 0, left = 0, below = 0;
        if (i > 0) {
            left = cell[MEMBRANE_P - MEMBRANE_NZ * side] / w->m;
            warmer += T[c - side] - T[c];
        }
        if (j > 0) {
            below = cell[MEMBRANE_P - MEMBRANE_NZ] / w->m;
            warmer += T[c - 1] - T[c];
        }
        if (i + 1 < side) {
            force += fx[c + side];
            warmer += T[c + side] - T[c];
        }
        if (j + 1 < side) {
            force += fy[c + 1];
            warmer += T[c + 1] - T[c];
        }
        rate[MEMBRANE_P] = force;
        rate[MEMBRANE_X] = v - left;
        rate[MEMBRANE_Y] = v - below;
        rate[MEMBRANE_S] = (w->K * warmer + w->mu * v * v) / T[c];
    }
    ++*w->rates;
}

// --- the pattern of the Jacobian ---

// Whether the rate of component `to` of a cell depends on component `from` of the cell (di, dj)
// before it.
static int depends(int to, int from, int di, int dj) {
    const int distance = (di != 0) + (dj != 0);
    if (distance == 0) { // its own springs, temperature and velocity
        return to == from || to == MEMBRANE_S || to == MEMBRANE_P || from == MEMBRANE_P;
    }
    if (to == MEMBRANE_S) { // conduction
        return from != MEMBRANE_P;
    }
    if (from == MEMBRANE_P) { // the springs towards the cells before
        return (to == MEMBRANE_X && di > 0) || (to == MEMBRANE_Y && dj > 0);
    }
    return to == MEMBRANE_P && (di < 0 || dj < 0); // the springs of the cells behind
}

const pm_ode_pattern *membrane_pattern(const membrane *w, pm_arena *arena) {
    static const int offset[5][2] = {{-1, 0}, {0, -1}, {0, 0}, {0, 1}, {1, 0}};
    const int side = w->side, nz = MEMBRANE_NZ * side * side;
    pm_ode_pattern *pattern = pm_arena_alloc(arena, sizeof *pattern);
    int *start = pm_arena_array(arena, (size_t)nz + 1, sizeof *start);
    int *row = pm_arena_array(arena, (size_t)nz * 12, sizeof *row), n = 0;
    if (pattern == NULL || start == NULL || row == NULL) {
        return NULL;
    }
    for (int column = 0; column < nz; ++column) {
        const int i = column / MEMBRANE_NZ / side, j = column / MEMBRANE_NZ % side;
        for (int k = 0; k < 5; ++k) {
            const int di = offset[k][0], dj = offset[k][1];
            if (i + di < 0 || i + di >= side || j + dj < 0 || j + dj >= side) {
                continue;
            }
            for (int to = 0; to < MEMBRANE_NZ; ++to) {
                if (depends(to, column % MEMBRANE_NZ, di, dj)) {
                    row[n++] = MEMBRANE_NZ * ((i + di) * side + j + dj) + to;
                }
            }
        }
        start[column + 1] = n;
    }
    *pattern = (pm_ode_pattern){.start = start, .row = row};
    return pattern;
}

// --- totals and the start ---

double membrane_energy(const membrane *w, const double *z) {
    double energy = 0;
    for (int c = 0; c < w->side * w->side; ++c) {
        const double *cell = z + (ptrdiff_t)MEMBRANE_NZ * c;
        const double p = cell[MEMBRANE_P], xx = cell[MEMBRANE_X] * cell[MEMBRANE_X],
                     yy = cell[MEMBRANE_Y] * cell[MEMBRANE_Y];
        energy += p * p / (2 * w->m) + w->k / 2 * (xx + yy) + w->n / 4 * (xx * xx + yy * yy) +
                  w->b * w->Tr * (cell[MEMBRANE_X] + cell[MEMBRANE_Y]) +
                  w->c * (temperature(w, cell) - w->Tr);
    }
    return energy;
}

double membrane_entropy(const membrane *w, const double *z) {
    double entropy = 0;
    for (int c = 0; c < w->side * w->side; ++c) {
        entropy += z[(ptrdiff_t)MEMBRANE_NZ * c + MEMBRANE_S];
    }
    return entropy;
}

// A bell of height 1 about the cell (i0, j0), `width` cells wide.
static double bell(int c, int side, double i0, double j0, double width) {
    const double di = (c / side - i0) / width, dj = (c % side - j0) / width;
    return exp(-0.5 * (di * di + dj * dj));
}

void membrane_start(const membrane *w, double *z) {
    const int side = w->side;
    for (int c = 0; c < side * side; ++c) {
        double *cell = z + (ptrdiff_t)MEMBRANE_NZ * c;
        const double T = w->Tr + 20 * bell(c, side, 0.3 * side, 0.6 * side, 0.1 * side);
        cell[MEMBRANE_P] = w->m * bell(c, side, 0.5 * side, 0.4 * side, 0.05 * side);
        cell[MEMBRANE_X] = cell[MEMBRANE_Y] = 0;
        cell[MEMBRANE_S] = w->c * log(T / w->Tr);
    }
}
