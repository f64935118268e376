// The forces of all elements at s->trial, for the iterations of a step: solid_element.c for the
// eight points of an element at once. Each quantity has a lane for each point, so that the compiler
// uses the processor's vectors.
#include <math.h>
#include <string.h>

#include "base/simd.h"
#include "model/solid/solid_parts.h"

typedef double lane[PM_BRICK_POINTS];

#define EACH for (int p = 0; p < PM_BRICK_POINTS; ++p)
// Without this the compiler would not vectorise these functions for each kind of processor.
#define INLINE static inline __attribute__((always_inline))

// Computes the derivatives d0, d1 of a learned function at x0, x1.
INLINE void slopes(const pm_learned_function *f, lane x0, lane x1, lane d0, lane d1) {
    const double *B = f->quadratic, a = 1 / f->scale[0], b = 1 / f->scale[1];
    EACH {
        d0[p] = f->linear[0] + B[0] * (x0[p] * a) + B[1] * (x1[p] * b);
        d1[p] = f->linear[1] + B[1] * (x0[p] * a) + B[2] * (x1[p] * b);
    }
    for (int k = 0; k < f->nunit; ++k) {
        const double *w = f->units + 4 * (ptrdiff_t)k;
        EACH {
            const double t = tanh(w[0] * (x0[p] * a) + w[1] * (x1[p] * b) + w[2]);
            d0[p] += w[3] * (1 - t * t) * w[0];
            d1[p] += w[3] * (1 - t * t) * w[1];
        }
    }
    EACH {
        d0[p] *= f->unit * a;
        d1[p] *= f->unit * b;
    }
}

// Computes the product of two symmetric tensors.
INLINE void product(lane *a, lane *b, lane ab[9]) {
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const double *a0 = a[pm_sym_at[i][0]], *a1 = a[pm_sym_at[i][1]],
                         *a2 = a[pm_sym_at[i][2]];
            const double *b0 = b[pm_sym_at[0][j]], *b1 = b[pm_sym_at[1][j]],
                         *b2 = b[pm_sym_at[2][j]];
            EACH {
                ab[3 * i + j][p] = a0[p] * b0[p] + a1[p] * b1[p] + a2[p] * b2[p];
            }
        }
    }
}

// Computes the product of a matrix and a symmetric tensor whose product is symmetric.
INLINE void times_symmetric(lane m[9], lane *a, lane *ma) {
    for (int i = 0; i < PM_SYM; ++i) {
        const double *m0 = m[3 * pm_sym_row[i]], *m1 = m[3 * pm_sym_row[i] + 1],
                     *m2 = m[3 * pm_sym_row[i] + 2];
        const int *at = pm_sym_at[pm_sym_column[i]];
        EACH {
            ma[i][p] = m0[p] * a[at[0]][p] + m1[p] * a[at[1]][p] + m2[p] * a[at[2]][p];
        }
    }
}

// Computes Q = open Cbar, the traces t2 and t3 of its powers, and the derivatives of the energy of
// a branch by both.
INLINE void branch_slopes(const pm_solid_branch *branch, lane *open, lane *Cbar, lane Q[9], lane d2,
                          lane d3) {
    lane t2 = {0}, t3 = {0};
    product(open, Cbar, Q);
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            EACH {
                const double entry = Q[3 * i][p] * Q[j][p] + Q[3 * i + 1][p] * Q[3 + j][p] +
                                     Q[3 * i + 2][p] * Q[6 + j][p];
                t2[p] += i == j ? entry : 0;
                t3[p] += entry * Q[3 * j + i][p];
            }
        }
    }
    slopes(&branch->energy, t2, t3, d2, d3);
}

// Computes the inner variables of a branch at the end of the step (pm_solid_branch_relax).
INLINE void relax(const pm_solid_branch *branch, const pm_solid_relaxation *step,
                  const pm_solid_start *start, lane *Cbar, lane *inverse, const double *before,
                  ptrdiff_t stride, lane *after) {
    lane middle[PM_SYM], open[PM_SYM], Q[9], d2, d3, Qopen[PM_SYM], g[PM_SYM], Qg[PM_SYM];
    for (int i = 0; i < PM_SYM; ++i) {
        const double one = i < 3;
        EACH {
            const double from = before[p * stride + i];
            after[i][p] = step->decay * from + step->start * (start->inverse[i][p] - one) +
                          step->end * (inverse[i][p] - one);
            middle[i][p] = (start->Cbar[i][p] + Cbar[i][p]) / 2;
            open[i][p] =
                (start->inverse[i][p] + inverse[i][p]) / 2 - one - (from + after[i][p]) / 2;
        }
    }
    branch_slopes(branch, open, middle, Q, d2, d3);
    times_symmetric(Q, open, Qopen);
    for (int i = 0; i < PM_SYM; ++i) {
        EACH {
            g[i][p] = 2 * d2[p] * open[i][p] + 3 * d3[p] * Qopen[i][p];
        }
    }
    times_symmetric(Q, g, Qg);
    const double h = step->h * step->mean;
    for (int i = 0; i < PM_SYM; ++i) {
        EACH {
            after[i][p] +=
                h * (branch->m * (g[i][p] - branch->s * Qg[i][p]) - branch->rate * open[i][p]);
        }
    }
}

// Adds d psi/d Cbar of a branch with the inner variables `inner` to T.
INLINE void add_branch(const pm_solid_branch *branch, lane *Cbar, lane *inverse, lane *inner,
                       lane *T) {
    lane open[PM_SYM], A[PM_SYM], Q[9], d2, d3, QA[PM_SYM], QQA[PM_SYM];
    for (int i = 0; i < PM_SYM; ++i) {
        const double one = i < 3;
        EACH {
            open[i][p] = inverse[i][p] - one - inner[i][p];
            A[i][p] = inner[i][p] + one;
        }
    }
    branch_slopes(branch, open, Cbar, Q, d2, d3);
    times_symmetric(Q, A, QA);
    times_symmetric(Q, QA, QQA);
    for (int i = 0; i < PM_SYM; ++i) {
        EACH {
            T[i][p] -= 2 * d2[p] * QA[i][p] + 3 * d3[p] * QQA[i][p];
        }
    }
}

// Adds d psi/d Cbar of the spring to T.
INLINE void add_spring(const pm_solid_material *material, lane *Cbar, lane *T) {
    lane I1, x0, x1, d1, d2;
    EACH {
        double square = 0;
        for (int i = 0; i < PM_SYM; ++i) {
            square += (i < 3 ? 1 : 2) * Cbar[i][p] * Cbar[i][p];
        }
        I1[p] = Cbar[0][p] + Cbar[1][p] + Cbar[2][p];
        x0[p] = I1[p] - 3;
        x1[p] = (I1[p] * I1[p] - square) / 2 - 3;
    }
    slopes(&material->spring, x0, x1, d1, d2);
    for (int i = 0; i < PM_SYM; ++i) {
        EACH {
            T[i][p] += (i < 3 ? d1[p] + d2[p] * I1[p] : 0) - d2[p] * Cbar[i][p];
        }
    }
}

// The shapes at all points of an element (pm_solid_shape).
typedef struct element_shape {
    lane F[9], J, factor, Cbar[PM_SYM], inverse[PM_SYM];
} element_shape;

INLINE void deform(const pm_brick *brick, const double *x, lane F[9]) {
    for (int i = 0; i < 9; ++i) {
        EACH {
            F[i][p] = i % 4 == 0;
        }
    }
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        for (int i = 0; i < 9; ++i) {
            const double u = x[3 * n + i / 3], *g = brick->gradient[n][i % 3];
            EACH {
                F[i][p] += u * g[p];
            }
        }
    }
}

// Returns false if the element is turned inside out.
INLINE bool make_shape(const pm_brick *brick, const double *x, element_shape *e) {
    bool good = true;
    lane C[PM_SYM];
    deform(brick, x, e->F);
    lane *F = e->F;
    EACH {
        e->J[p] = F[0][p] * (F[4][p] * F[8][p] - F[5][p] * F[7][p]) -
                  F[1][p] * (F[3][p] * F[8][p] - F[5][p] * F[6][p]) +
                  F[2][p] * (F[3][p] * F[7][p] - F[4][p] * F[6][p]);
    }
    EACH {
        const double root = cbrt(e->J[p]);
        good = good && e->J[p] > 0;
        e->factor[p] = 1 / (root * root);
    }
    for (int i = 0; i < PM_SYM; ++i) {
        const int r = pm_sym_row[i], c = pm_sym_column[i];
        EACH {
            C[i][p] = e->factor[p] *
                      (F[r][p] * F[c][p] + F[3 + r][p] * F[3 + c][p] + F[6 + r][p] * F[6 + c][p]);
        }
    }
    memcpy(e->Cbar, C, sizeof C);
    EACH {
        const double xx = C[1][p] * C[2][p] - C[5][p] * C[5][p];
        const double xy = C[4][p] * C[5][p] - C[3][p] * C[2][p];
        const double xz = C[3][p] * C[5][p] - C[4][p] * C[1][p];
        const double factor = 1 / (C[0][p] * xx + C[3][p] * xy + C[4][p] * xz);
        e->inverse[0][p] = xx * factor;
        e->inverse[1][p] = (C[0][p] * C[2][p] - C[4][p] * C[4][p]) * factor;
        e->inverse[2][p] = (C[0][p] * C[1][p] - C[3][p] * C[3][p]) * factor;
        e->inverse[3][p] = xy * factor;
        e->inverse[4][p] = xz * factor;
        e->inverse[5][p] = (C[3][p] * C[4][p] - C[0][p] * C[5][p]) * factor;
    }
    return good;
}

// Computes the forces on the nodes from d psi/d Cbar and the pressure.
INLINE void find_force(const pm_brick *brick, element_shape *e, lane *T, double pressure,
                       double *force) {
    lane S[PM_SYM], P[9], mean;
    EACH {
        double dot = 0;
        for (int i = 0; i < PM_SYM; ++i) {
            dot += (i < 3 ? 1 : 2) * T[i][p] * e->Cbar[i][p];
        }
        mean[p] = dot / 3;
    }
    for (int i = 0; i < PM_SYM; ++i) {
        EACH {
            S[i][p] = brick->weight[p] * e->factor[p] *
                      (2 * (T[i][p] - mean[p] * e->inverse[i][p]) +
                       pressure * e->J[p] * e->inverse[i][p]);
        }
    }
    for (int i = 0; i < 9; ++i) {
        lane *F = e->F + i / 3 * 3;
        const int *at = pm_sym_at[i % 3];
        EACH {
            P[i][p] = F[0][p] * S[at[0]][p] + F[1][p] * S[at[1]][p] + F[2][p] * S[at[2]][p];
        }
    }
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        const double(*g)[PM_BRICK_POINTS] = brick->gradient[n];
        for (int i = 0; i < 3; ++i) {
            lane part;
            EACH {
                part[p] =
                    P[3 * i][p] * g[0][p] + P[3 * i + 1][p] * g[1][p] + P[3 * i + 2][p] * g[2][p];
            }
            force[3 * n + i] = ((part[0] + part[1]) + (part[2] + part[3])) +
                               ((part[4] + part[5]) + (part[6] + part[7]));
        }
    }
}

// Computes the forces of an element, with the displacements x, on its nodes. Returns false if it is
// turned inside out.
PM_SIMD_CLONES
static bool evaluate_element(const pm_solid *s, int element, const pm_solid_relaxation *step,
                             const double *x, double *force) {
    const pm_brick *brick = &s->brick[element];
    const pm_solid_start *start = &s->start[element];
    const pm_solid_material *material = s->material;
    const ptrdiff_t stride = material->nbranch * PM_SYM;
    element_shape e;
    lane T[PM_SYM] = {{0}};
    double volume = 0, pressure, modulus;
    if (!make_shape(brick, x, &e)) {
        return false;
    }
    EACH {
        volume += brick->weight[p] * e.J[p];
    }
    pm_solid_volume(material, volume / brick->volume, &pressure, &modulus);
    add_spring(material, e.Cbar, T);
    for (int b = 0; b < material->nbranch; ++b) {
        lane after[PM_SYM];
        const double *before = s->inner + element * PM_BRICK_POINTS * stride + PM_SYM * b;
        relax(&material->branch[b], &step[b], start, e.Cbar, e.inverse, before, stride, after);
        add_branch(&material->branch[b], e.Cbar, e.inverse, after, T);
    }
    find_force(brick, &e, T, pressure, force);
    return true;
}

bool pm_solid_forces(pm_solid *s, double h) {
    pm_solid_relaxation step[PM_SOLID_MAX_BRANCHES];
    for (int b = 0; b < s->material->nbranch; ++b) {
        step[b] = pm_solid_branch_relaxation(&s->material->branch[b], h);
    }
    memset(s->force, 0, 3 * (size_t)s->mesh->nnode * sizeof *s->force);
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double x[3 * PM_BRICK_NODES], force[3 * PM_BRICK_NODES];
        const int *node = s->mesh->brick + (ptrdiff_t)e * PM_BRICK_NODES;
        pm_solid_gather(s, e, s->trial, x);
        if (!evaluate_element(s, e, step, x, force)) {
            return false;
        }
        for (int i = 0; i < 3 * PM_BRICK_NODES; ++i) {
            s->force[3 * node[i / 3] + i % 3] += force[i];
        }
    }
    return true;
}
