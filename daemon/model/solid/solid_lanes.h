// The learned functions of a material and the kinematics of a brick (material.h, brick.h) at all
// points of an element at once. Every quantity is a vector with a lane for each point.
#ifndef PM_MODEL_SOLID_SOLID_LANES_H
#define PM_MODEL_SOLID_SOLID_LANES_H

#include <math.h>
#include <string.h>

#include "base/lanes.h"
#include "model/solid/solid_parts.h"

_Static_assert(PM_BRICK_POINTS == PM_LANES, "a lane for each point");

// Relative volumes in this range have a power by Newton's method, others by the C library.
#define PM_LANE_LEAST_VOLUME 0.7
#define PM_LANE_LARGEST_VOLUME 1.4

// The shapes at all points of an element (pm_solid_shape).
typedef struct pm_lane_shape {
    pm_lane F[9], J, factor, Cbar[PM_SYM], inverse[PM_SYM];
} pm_lane_shape;

// --- memory ---

// Copies a symmetric tensor at each point from x, where points are `stride` numbers apart, and
// back.
PM_LANE_FUNCTION void pm_lanes_gather(const double *x, ptrdiff_t stride, pm_lane *to) {
    for (int i = 0; i < PM_SYM; ++i) {
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            to[i][p] = x[p * stride + i];
        }
    }
}

PM_LANE_FUNCTION void pm_lanes_scatter(const pm_lane *from, ptrdiff_t stride, double *x) {
    for (int i = 0; i < PM_SYM; ++i) {
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            x[p * stride + i] = from[i][p];
        }
    }
}

// --- tensors ---

// Computes the product [9] of two symmetric tensors.
PM_LANE_FUNCTION void pm_lane_product(const pm_lane *a, const pm_lane *b, pm_lane *ab) {
    for (int i = 0; i < 9; ++i) {
        const int *row = pm_sym_at[i / 3], *column = pm_sym_at[i % 3];
        ab[i] = a[row[0]] * b[column[0]] + a[row[1]] * b[column[1]] + a[row[2]] * b[column[2]];
    }
}

// Computes the product of a matrix and a symmetric tensor whose product is symmetric.
PM_LANE_FUNCTION void pm_lane_times_sym(const pm_lane *m, const pm_lane *a, pm_lane *ma) {
    for (int i = 0; i < PM_SYM; ++i) {
        const pm_lane *row = m + 3 * pm_sym_row[i];
        const int *at = pm_sym_at[pm_sym_column[i]];
        ma[i] = row[0] * a[at[0]] + row[1] * a[at[1]] + row[2] * a[at[2]];
    }
}

// --- learned functions ---

// Computes the value of a learned function at the inputs x [2], and its derivatives slope [2].
PM_LANE_FUNCTION void pm_lane_function(const pm_learned_function *f, const pm_lane *x,
                                       pm_lane *value, pm_lane *slope) {
    const double *B = f->quadratic, a = 1 / f->scale[0], b = 1 / f->scale[1];
    const pm_lane y[2] = {x[0] * a, x[1] * b};
    const pm_lane by[2] = {B[0] * y[0] + B[1] * y[1], B[1] * y[0] + B[2] * y[1]};
    slope[0] = f->linear[0] + by[0];
    slope[1] = f->linear[1] + by[1];
    *value = (f->linear[0] + by[0] / 2) * y[0] + (f->linear[1] + by[1] / 2) * y[1];
    for (int k = 0; k < f->nunit; ++k) {
        const double *w = f->units + 4 * (ptrdiff_t)k;
        pm_lane t = w[0] * y[0] + w[1] * y[1] + w[2];
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            t[p] = tanh(t[p]);
        }
        const pm_lane by_input = w[3] * (1 - t * t);
        *value += w[3] * (t - tanh(w[2]));
        slope[0] += by_input * w[0];
        slope[1] += by_input * w[1];
    }
    *value *= f->unit;
    slope[0] *= f->unit * a;
    slope[1] *= f->unit * b;
}

// Computes the energy of the spring, J/m^3, and adds d psi/d Cbar to T.
PM_LANE_FUNCTION void pm_lane_spring(const pm_solid_material *material, const pm_lane *Cbar,
                                     pm_lane *energy, pm_lane *T) {
    const pm_lane *C = Cbar, I1 = C[0] + C[1] + C[2];
    const pm_lane square =
        C[0] * C[0] + C[1] * C[1] + C[2] * C[2] + 2 * (C[3] * C[3] + C[4] * C[4] + C[5] * C[5]);
    const pm_lane x[2] = {I1 - 3, (I1 * I1 - square) / 2 - 3};
    pm_lane slope[2];
    pm_lane_function(&material->spring, x, energy, slope);
    for (int i = 0; i < PM_SYM; ++i) {
        T[i] -= slope[1] * C[i];
    }
    for (int i = 0; i < 3; ++i) {
        T[i] += slope[0] + slope[1] * I1;
    }
}

// Computes Q = open Cbar, and the energy of a branch with its derivatives slope [2] by the traces
// of the second and the third power of Q.
PM_LANE_FUNCTION void pm_lane_deviation(const pm_solid_branch *branch, const pm_lane *open,
                                        const pm_lane *Cbar, pm_lane *Q, pm_lane *energy,
                                        pm_lane *slope) {
    pm_lane x[2] = {{0}, {0}};
    pm_lane_product(open, Cbar, Q);
    for (int i = 0; i < 9; ++i) {
        const pm_lane *row = Q + i / 3 * 3, *column = Q + i % 3;
        const pm_lane entry = row[0] * column[0] + row[1] * column[3] + row[2] * column[6];
        x[1] += entry * Q[i % 3 * 3 + i / 3];
        if (i % 4 == 0) {
            x[0] += entry;
        }
    }
    pm_lane_function(&branch->energy, x, energy, slope);
}

// Computes open = Cbar^-1 - A with A = 1 + inner.
PM_LANE_FUNCTION void pm_lane_open(const pm_lane *inverse, const pm_lane *inner, pm_lane *open) {
    for (int i = 0; i < PM_SYM; ++i) {
        open[i] = (i < 3 ? inverse[i] - 1 : inverse[i]) - inner[i];
    }
}

// Computes the energy of a branch, J/m^3.
PM_LANE_FUNCTION void pm_lane_branch_energy(const pm_solid_branch *branch, const pm_lane *Cbar,
                                            const pm_lane *inverse, const pm_lane *inner,
                                            pm_lane *energy) {
    pm_lane open[PM_SYM], Q[9], slope[2];
    pm_lane_open(inverse, inner, open);
    pm_lane_deviation(branch, open, Cbar, Q, energy, slope);
}

// Adds d psi/d Cbar of a branch to T.
PM_LANE_FUNCTION void pm_lane_branch_stress(const pm_solid_branch *branch, const pm_lane *Cbar,
                                            const pm_lane *inverse, const pm_lane *inner,
                                            pm_lane *T) {
    pm_lane open[PM_SYM], A[PM_SYM], Q[9], energy, slope[2], QA[PM_SYM], QQA[PM_SYM];
    pm_lane_open(inverse, inner, open);
    for (int i = 0; i < PM_SYM; ++i) {
        A[i] = i < 3 ? inner[i] + 1 : inner[i];
    }
    pm_lane_deviation(branch, open, Cbar, Q, &energy, slope);
    pm_lane_times_sym(Q, A, QA);
    pm_lane_times_sym(Q, QA, QQA);
    for (int i = 0; i < PM_SYM; ++i) {
        T[i] -= 2 * slope[0] * QA[i] + 3 * slope[1] * QQA[i];
    }
}

// --- relaxation ---

// The shapes at the start of a step, and the inner variables of a branch there.
typedef struct pm_lane_before {
    pm_lane Cbar[PM_SYM], inverse[PM_SYM], inner[PM_SYM];
} pm_lane_before;

// Computes the inner variables `after` (A - 1) of a branch at the end of a step to the shape `end`,
// by an exponential method of second order which is stable for steps of any length.
PM_LANE_FUNCTION void pm_lane_relax(const pm_solid_branch *branch, const pm_solid_relaxation *step,
                                    const pm_lane_before *before, const pm_lane_shape *end,
                                    pm_lane *after) {
    pm_lane middle[PM_SYM], open[PM_SYM], Q[9], energy, slope[2], Qopen[PM_SYM], g[PM_SYM],
        Qg[PM_SYM];
    for (int i = 0; i < PM_SYM; ++i) {
        const pm_lane a = i < 3 ? before->inverse[i] - 1 : before->inverse[i];
        const pm_lane b = i < 3 ? end->inverse[i] - 1 : end->inverse[i];
        after[i] = step->decay * before->inner[i] + step->start * a + step->end * b;
        middle[i] = (before->Cbar[i] + end->Cbar[i]) / 2;
        open[i] = (a + b - before->inner[i] - after[i]) / 2;
    }
    pm_lane_deviation(branch, open, middle, Q, &energy, slope);
    pm_lane_times_sym(Q, open, Qopen);
    for (int i = 0; i < PM_SYM; ++i) {
        g[i] = 2 * slope[0] * open[i] + 3 * slope[1] * Qopen[i];
    }
    pm_lane_times_sym(Q, g, Qg);
    // The rate less its linear part, which decay, start and end contain.
    for (int i = 0; i < PM_SYM; ++i) {
        after[i] += step->h * step->mean *
                    (branch->m * (g[i] - branch->s * Qg[i]) - branch->rate * open[i]);
    }
}

// --- kinematics ---

// Computes the deformation gradients from the displacements u [PM_BRICK_NODES][3].
PM_LANE_FUNCTION void pm_lane_deform(const pm_brick *brick, const double *u, pm_lane *F) {
    for (int i = 0; i < 9; ++i) {
        F[i] = (pm_lane){0} + (i % 4 == 0);
    }
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        pm_lane g[3];
        pm_lanes_load(3, brick->gradient[n][0], g);
        for (int i = 0; i < 9; ++i) {
            F[i] += u[3 * n + i / 3] * g[i % 3];
        }
    }
}

// Computes J^(-2/3). Returns false if a J is not positive.
PM_LANE_FUNCTION bool pm_lane_volume_power(const pm_lane *J, pm_lane *power) {
    bool usual = true, good = true;
    for (int p = 0; p < PM_BRICK_POINTS; ++p) {
        const double v = (*J)[p];
        usual &= v > PM_LANE_LEAST_VOLUME && v < PM_LANE_LARGEST_VOLUME;
        good &= v > 0;
    }
    if (usual) {
        // The Taylor series at 1 is wrong by at most 0.01; each step doubles the right digits.
        const pm_lane e = *J - 1;
        pm_lane root = 1 - e / 3 + e * e * (2.0 / 9);
        for (int k = 0; k < 4; ++k) {
            root = root * (4 - *J * root * root * root) / 3;
        }
        *power = root * root;
        return true;
    }
    for (int p = 0; p < PM_BRICK_POINTS; ++p) {
        const double root = cbrt((*J)[p]);
        (*power)[p] = 1 / (root * root);
    }
    return good;
}

// Computes the shapes for the displacements u [PM_BRICK_NODES][3]. Returns false if the element is
// turned inside out.
PM_LANE_FUNCTION bool pm_lane_shape_make(const pm_brick *brick, const double *u,
                                         pm_lane_shape *shape) {
    pm_lane *F = shape->F, *C = shape->Cbar, *inverse = shape->inverse;
    pm_lane_deform(brick, u, F);
    shape->J = F[0] * (F[4] * F[8] - F[5] * F[7]) - F[1] * (F[3] * F[8] - F[5] * F[6]) +
               F[2] * (F[3] * F[7] - F[4] * F[6]);
    if (!pm_lane_volume_power(&shape->J, &shape->factor)) {
        return false;
    }
    for (int i = 0; i < PM_SYM; ++i) {
        const pm_lane *a = F + pm_sym_row[i], *b = F + pm_sym_column[i];
        C[i] = shape->factor * (a[0] * b[0] + a[3] * b[3] + a[6] * b[6]);
    }
    const pm_lane xx = C[1] * C[2] - C[5] * C[5], xy = C[4] * C[5] - C[3] * C[2],
                  xz = C[3] * C[5] - C[4] * C[1];
    const pm_lane factor = 1 / (C[0] * xx + C[3] * xy + C[4] * xz);
    inverse[0] = xx * factor;
    inverse[1] = (C[0] * C[2] - C[4] * C[4]) * factor;
    inverse[2] = (C[0] * C[1] - C[3] * C[3]) * factor;
    inverse[3] = xy * factor;
    inverse[4] = xz * factor;
    inverse[5] = (C[3] * C[4] - C[0] * C[5]) * factor;
    return true;
}

// Returns the energy of volume of an element, J, and the pressure, Pa.
PM_LANE_FUNCTION double pm_lane_volume(const pm_solid_material *material, const pm_brick *brick,
                                       const pm_lane_shape *shape, double *pressure) {
    pm_lane weight;
    double modulus;
    pm_lanes_load(1, brick->weight, &weight);
    weight *= shape->J;
    return brick->volume *
           pm_solid_volume(material, pm_lane_sum(&weight) / brick->volume, pressure, &modulus);
}

// Computes the second Piola-Kirchhoff stress S from T = d psi/d Cbar and the pressure, Pa.
PM_LANE_FUNCTION void pm_lane_piola(const pm_lane_shape *shape, const pm_lane *T, double pressure,
                                    pm_lane *S) {
    const pm_lane *C = shape->Cbar;
    const pm_lane mean =
        (T[0] * C[0] + T[1] * C[1] + T[2] * C[2] + 2 * (T[3] * C[3] + T[4] * C[4] + T[5] * C[5])) /
        3;
    for (int i = 0; i < PM_SYM; ++i) {
        S[i] = shape->factor *
               (2 * (T[i] - mean * shape->inverse[i]) + pressure * shape->J * shape->inverse[i]);
    }
}

// Computes the first Piola-Kirchhoff stress P [9] = F S.
PM_LANE_FUNCTION void pm_lane_first_piola(const pm_lane_shape *shape, const pm_lane *S,
                                          pm_lane *P) {
    for (int i = 0; i < 9; ++i) {
        const pm_lane *F = shape->F + i / 3 * 3;
        const int *at = pm_sym_at[i % 3];
        P[i] = F[0] * S[at[0]] + F[1] * S[at[1]] + F[2] * S[at[2]];
    }
}

#endif
