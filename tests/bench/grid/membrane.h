// SPDX-License-Identifier: MIT
// A membrane of masses that move across a square grid, as an ODE for CVODE. Each cell (i, j) has a
// mass with the momentum p, two springs with the elongations x and y towards the cells (i-1, j) and
// (i, j-1), or towards a wall where there is none, and an entropy s. With u = x + y and the
// temperature T = Tr exp((s - b u) / c) the energy of a cell is
//     E = p^2/(2m) + k/2 (x^2 + y^2) + n/4 (x^4 + y^4) + b Tr u + c (T - Tr)
// Friction mu v against the ground warms the cell, and neighbours conduct the heat K (T' - T). The
// scene in bench_grid.c describes the same system by formulas.
#ifndef TESTS_BENCH_GRID_MEMBRANE_H
#define TESTS_BENCH_GRID_MEMBRANE_H

#include "base/arena.h"
#include "truth/ode.h"

// The components of a cell. Cell (i, j) begins at component MEMBRANE_NZ (i side + j) of the state.
enum { MEMBRANE_P, MEMBRANE_X, MEMBRANE_Y, MEMBRANE_S, MEMBRANE_NZ };

typedef struct membrane {
    int side;       // cells along each edge
    double m, k, n; // kg, N/m, N/m^3
    double b, c;    // J/(K m), J/K
    double mu;      // kg/s
    double Tr;      // K
    double K;       // W/K
    double *work;   // [3 side^2] temperatures, K, and tensions dE/dx and dE/dy, N
    long *rates;    // counts the evaluations of the rate
} membrane;

// Computes zdot at the state z; `data` is the membrane.
void membrane_rate(const void *data, const double *z, double *zdot);
// Returns, in the arena, which rates depend on which components (ode.h). NULL: out of memory.
const pm_ode_pattern *membrane_pattern(const membrane *membrane, pm_arena *arena);

double membrane_energy(const membrane *membrane, const double *z);  // total energy, J
double membrane_entropy(const membrane *membrane, const double *z); // total entropy, J/K

// Sets the start: a blow in the middle gives the masses there a velocity, and a spot beside it is
// warm. All springs are at rest.
void membrane_start(const membrane *membrane, double *z);

#endif
