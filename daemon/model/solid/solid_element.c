// Evaluates all elements of a body: forces, energies and stresses. The learned functions of a
// material and the kinematics of a brick (material.h, brick.h) are evaluated at all points of an
// element at once: every quantity is a vector with a lane for each point.
#include <math.h>
#include <string.h>

#include "base/lanes.h"
#include "base/simd.h"
#include "model/solid/solid_parts.h"

_Static_assert(PM_BRICK_POINTS == PM_LANES, "a lane for each point");

// Relative volumes in this range have a power by Newton's method, others by the C library.
#define LEAST_VOLUME 0.7
#define LARGEST_VOLUME 1.4

// The shapes at all points of an element (pm_solid_shape).
typedef struct lane_shape {
    pm_lane F[9], J, factor, Cbar[PM_SYM], inverse[PM_SYM];
} lane_shape;

// --- memory ---

// Copies a symmetric tensor at each point from x, where points are `stride` numbers apart, and
// back.
PM_LANE_FUNCTION void gather_tensors(const double *x, ptrdiff_t stride, pm_lane *to) {
    for (int i = 0; i < PM_SYM; ++i) {
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            to[i][p] = x[p * stride + i];
        }
    }
}

PM_LANE_FUNCTION void scatter_tensors(const pm_lane *from, ptrdiff_t stride, double *x) {
    for (int i = 0; i < PM_SYM; ++i) {
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            x[p * stride + i] = from[i][p];
        }
    }
}

// --- tensors ---

// Computes the product [9] of two symmetric tensors.
PM_LANE_FUNCTION void product(const pm_lane *a, const pm_lane *b, pm_lane *ab) {
    for (int i = 0; i < 9; ++i) {
        const int *row = pm_sym_at[i / 3], *column = pm_sym_at[i % 3];
        ab[i] = a[row[0]] * b[column[0]] + a[row[1]] * b[column[1]] + a[row[2]] * b[column[2]];
    }
}

// Computes the product of a matrix and a symmetric tensor whose product is symmetric.
PM_LANE_FUNCTION void times_sym(const pm_lane *m, const pm_lane *a, pm_lane *ma) {
    for (int i = 0; i < PM_SYM; ++i) {
        const pm_lane *row = m + 3 * pm_sym_row[i];
        const int *at = pm_sym_at[pm_sym_column[i]];
        ma[i] = row[0] * a[at[0]] + row[1] * a[at[1]] + row[2] * a[at[2]];
    }
}

// --- learned functions ---

// Computes the value of a learned function at the inputs x [2], and its derivatives slope [2].
PM_LANE_FUNCTION void learned_function(const pm_learned_function *f, const pm_lane *x,
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
PM_LANE_FUNCTION void spring_energy(const pm_solid_material *material, const pm_lane *Cbar,
                                    pm_lane *energy, pm_lane *T) {
    const pm_lane *C = Cbar, I1 = C[0] + C[1] + C[2];
    const pm_lane square =
        C[0] * C[0] + C[1] * C[1] + C[2] * C[2] + 2 * (C[3] * C[3] + C[4] * C[4] + C[5] * C[5]);
    const pm_lane x[2] = {I1 - 3, (I1 * I1 - square) / 2 - 3};
    pm_lane slope[2];
    learned_function(&material->spring, x, energy, slope);
    for (int i = 0; i < PM_SYM; ++i) {
        T[i] -= slope[1] * C[i];
    }
    for (int i = 0; i < 3; ++i) {
        T[i] += slope[0] + slope[1] * I1;
    }
}

// Computes Q = open Cbar, and the energy of a branch with its derivatives slope [2] by the traces
// of the second and the third power of Q.
PM_LANE_FUNCTION void deviation(const pm_solid_branch *branch, const pm_lane *open,
                                const pm_lane *Cbar, pm_lane *Q, pm_lane *energy, pm_lane *slope) {
    pm_lane x[2] = {{0}, {0}};
    product(open, Cbar, Q);
    for (int i = 0; i < 9; ++i) {
        const pm_lane *row = Q + i / 3 * 3, *column = Q + i % 3;
        const pm_lane entry = row[0] * column[0] + row[1] * column[3] + row[2] * column[6];
        x[1] += entry * Q[i % 3 * 3 + i / 3];
        if (i % 4 == 0) {
            x[0] += entry;
        }
    }
    learned_function(&branch->energy, x, energy, slope);
}

// Computes open = Cbar^-1 - A with A = 1 + inner.
PM_LANE_FUNCTION void find_open(const pm_lane *inverse, const pm_lane *inner, pm_lane *open) {
    for (int i = 0; i < PM_SYM; ++i) {
        open[i] = (i < 3 ? inverse[i] - 1 : inverse[i]) - inner[i];
    }
}

// Computes the energy of a branch, J/m^3.
PM_LANE_FUNCTION void branch_energy(const pm_solid_branch *branch, const pm_lane *Cbar,
                                    const pm_lane *inverse, const pm_lane *inner, pm_lane *energy) {
    pm_lane open[PM_SYM], Q[9], slope[2];
    find_open(inverse, inner, open);
    deviation(branch, open, Cbar, Q, energy, slope);
}

// Adds d psi/d Cbar of a branch to T.
PM_LANE_FUNCTION void branch_stress(const pm_solid_branch *branch, const pm_lane *Cbar,
                                    const pm_lane *inverse, const pm_lane *inner, pm_lane *T) {
    pm_lane open[PM_SYM], A[PM_SYM], Q[9], energy, slope[2], QA[PM_SYM], QQA[PM_SYM];
    find_open(inverse, inner, open);
    for (int i = 0; i < PM_SYM; ++i) {
        A[i] = i < 3 ? inner[i] + 1 : inner[i];
    }
    deviation(branch, open, Cbar, Q, &energy, slope);
    times_sym(Q, A, QA);
    times_sym(Q, QA, QQA);
    for (int i = 0; i < PM_SYM; ++i) {
        T[i] -= 2 * slope[0] * QA[i] + 3 * slope[1] * QQA[i];
    }
}

// --- relaxation ---

// The shapes at the start of a step, and the inner variables of a branch there.
typedef struct lane_before {
    pm_lane Cbar[PM_SYM], inverse[PM_SYM], inner[PM_SYM];
} lane_before;

// Computes the inner variables `after` (A - 1) of a branch at the end of a step to the shape `end`,
// by an exponential method of second order which is stable for steps of any length.
PM_LANE_FUNCTION void relax(const pm_solid_branch *branch, const pm_solid_relaxation *step,
                            const lane_before *before, const lane_shape *end, pm_lane *after) {
    pm_lane middle[PM_SYM], open[PM_SYM], Q[9], energy, slope[2], Qopen[PM_SYM], g[PM_SYM],
        Qg[PM_SYM];
    for (int i = 0; i < PM_SYM; ++i) {
        const pm_lane a = i < 3 ? before->inverse[i] - 1 : before->inverse[i];
        const pm_lane b = i < 3 ? end->inverse[i] - 1 : end->inverse[i];
        after[i] = step->decay * before->inner[i] + step->start * a + step->end * b;
        middle[i] = (before->Cbar[i] + end->Cbar[i]) / 2;
        open[i] = (a + b - before->inner[i] - after[i]) / 2;
    }
    deviation(branch, open, middle, Q, &energy, slope);
    times_sym(Q, open, Qopen);
    for (int i = 0; i < PM_SYM; ++i) {
        g[i] = 2 * slope[0] * open[i] + 3 * slope[1] * Qopen[i];
    }
    times_sym(Q, g, Qg);
    // The rate less its linear part, which decay, start and end contain.
    for (int i = 0; i < PM_SYM; ++i) {
        after[i] += step->h * step->mean *
                    (branch->m * (g[i] - branch->s * Qg[i]) - branch->rate * open[i]);
    }
}

// --- kinematics ---

// Computes the deformation gradients from the displacements u [PM_BRICK_NODES][3].
PM_LANE_FUNCTION void deform(const pm_brick *brick, const double *u, pm_lane *F) {
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
PM_LANE_FUNCTION bool volume_power(const pm_lane *J, pm_lane *power) {
    bool usual = true, good = true;
    for (int p = 0; p < PM_BRICK_POINTS; ++p) {
        const double v = (*J)[p];
        usual &= v > LEAST_VOLUME && v < LARGEST_VOLUME;
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
PM_LANE_FUNCTION bool make_shape(const pm_brick *brick, const double *u, lane_shape *shape) {
    pm_lane *F = shape->F, *C = shape->Cbar, *inverse = shape->inverse;
    deform(brick, u, F);
    shape->J = F[0] * (F[4] * F[8] - F[5] * F[7]) - F[1] * (F[3] * F[8] - F[5] * F[6]) +
               F[2] * (F[3] * F[7] - F[4] * F[6]);
    if (!volume_power(&shape->J, &shape->factor)) {
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
PM_LANE_FUNCTION double volume_energy(const pm_solid_material *material, const pm_brick *brick,
                                      const lane_shape *shape, double *pressure) {
    pm_lane weight;
    double modulus;
    pm_lanes_load(1, brick->weight, &weight);
    weight *= shape->J;
    return brick->volume *
           pm_solid_volume(material, pm_lane_sum(&weight) / brick->volume, pressure, &modulus);
}

// Computes the second Piola-Kirchhoff stress S from T = d psi/d Cbar and the pressure, Pa.
PM_LANE_FUNCTION void second_piola(const lane_shape *shape, const pm_lane *T, double pressure,
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
PM_LANE_FUNCTION void first_piola(const lane_shape *shape, const pm_lane *S, pm_lane *P) {
    for (int i = 0; i < 9; ++i) {
        const pm_lane *F = shape->F + i / 3 * 3;
        const int *at = pm_sym_at[i % 3];
        P[i] = F[0] * S[at[0]] + F[1] * S[at[1]] + F[2] * S[at[2]];
    }
}

// --- elements ---

// Returns the place of an element's inner variables in an array of all.
static ptrdiff_t inner_at(const pm_solid *s, int element) {
    return (ptrdiff_t)element * PM_BRICK_POINTS * s->material->nbranch * PM_SYM;
}

static void make_steps(const pm_solid *s, double h, pm_solid_relaxation *step) {
    for (int b = 0; b < s->material->nbranch; ++b) {
        step[b] = pm_solid_branch_relaxation(&s->material->branch[b], h);
    }
}

// --- forces ---

// Loads what a branch needs to know of the start of a step.
PM_LANE_FUNCTION void load_before(const pm_solid *s, int element, int b, lane_before *before) {
    const pm_solid_start *start = &s->start[element];
    const ptrdiff_t stride = s->material->nbranch * PM_SYM;
    pm_lanes_load(PM_SYM, start->Cbar[0], before->Cbar);
    pm_lanes_load(PM_SYM, start->inverse[0], before->inverse);
    gather_tensors(s->inner + inner_at(s, element) + PM_SYM * b, stride, before->inner);
}

// Computes the force on each node from the first Piola-Kirchhoff stress P.
PM_LANE_FUNCTION void find_force(const pm_brick *brick, pm_lane *P, double *force) {
    pm_lane weight;
    pm_lanes_load(1, brick->weight, &weight);
    for (int i = 0; i < 9; ++i) {
        P[i] *= weight;
    }
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        pm_lane g[3];
        pm_lanes_load(3, brick->gradient[n][0], g);
        for (int i = 0; i < 3; ++i) {
            const pm_lane part = P[3 * i] * g[0] + P[3 * i + 1] * g[1] + P[3 * i + 2] * g[2];
            force[3 * n + i] = pm_lane_sum(&part);
        }
    }
}

// Computes the forces of an element with the displacements x on its nodes. Returns false if it is
// turned inside out.
PM_SIMD_CLONES
static bool element_force(const pm_solid *s, int element, const pm_solid_relaxation *step,
                          const double *x, double *force) {
    const pm_solid_material *material = s->material;
    const pm_brick *brick = &s->brick[element];
    lane_shape shape;
    pm_lane T[PM_SYM] = {{0}}, S[PM_SYM], P[9], energy;
    double pressure;
    if (!make_shape(brick, x, &shape)) {
        return false;
    }
    volume_energy(material, brick, &shape, &pressure);
    spring_energy(material, shape.Cbar, &energy, T);
    for (int b = 0; b < material->nbranch; ++b) {
        lane_before before;
        pm_lane after[PM_SYM];
        load_before(s, element, b, &before);
        relax(&material->branch[b], &step[b], &before, &shape, after);
        branch_stress(&material->branch[b], shape.Cbar, shape.inverse, after, T);
    }
    second_piola(&shape, T, pressure, S);
    first_piola(&shape, S, P);
    find_force(brick, P, force);
    return true;
}

bool pm_solid_forces(pm_solid *s, double h) {
    pm_solid_relaxation step[PM_SOLID_MAX_BRANCHES];
    make_steps(s, h, step);
    memset(s->force, 0, 3 * (size_t)s->mesh->nnode * sizeof *s->force);
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double x[3 * PM_BRICK_NODES], force[3 * PM_BRICK_NODES];
        const int *node = s->mesh->brick + (ptrdiff_t)e * PM_BRICK_NODES;
        pm_solid_gather(s, e, s->trial, x);
        if (!element_force(s, e, step, x, force)) {
            return false;
        }
        for (int i = 0; i < 3 * PM_BRICK_NODES; ++i) {
            s->force[3 * node[i / 3] + i % 3] += force[i];
        }
    }
    return true;
}

// --- energies ---

// Adds up the energies of an element with the shape, whose inner variables are `inner`, and keeps
// what the next step needs. Returns the stored energy, J.
PM_LANE_FUNCTION double keep_start(const pm_solid *s, int element, const lane_shape *shape,
                                   const double *inner, pm_solid_start *start) {
    const pm_solid_material *material = s->material;
    const pm_brick *brick = &s->brick[element];
    pm_lane weight, psi, ignored[PM_SYM] = {{0}}, branch[PM_SYM], energy;
    double pressure;
    pm_lanes_load(1, brick->weight, &weight);
    pm_lanes_store(PM_SYM, shape->Cbar, start->Cbar[0]);
    pm_lanes_store(PM_SYM, shape->inverse, start->inverse[0]);
    start->volume = volume_energy(material, brick, shape, &pressure);
    spring_energy(material, shape->Cbar, &psi, ignored);
    pm_lanes_store(1, &psi, start->spring);
    for (int b = 0; b < material->nbranch; ++b) {
        gather_tensors(inner + PM_SYM * b, material->nbranch * PM_SYM, branch);
        branch_energy(&material->branch[b], shape->Cbar, shape->inverse, branch, &energy);
        pm_lanes_store(1, &energy, start->branch[b]);
        psi += energy;
    }
    psi *= weight;
    return start->volume + pm_lane_sum(&psi);
}

PM_SIMD_CLONES
static bool begin_element(pm_solid *s, int element, const double *x, const double *inner,
                          double *stored) {
    lane_shape shape;
    if (!make_shape(&s->brick[element], x, &shape)) {
        return false;
    }
    *stored += keep_start(s, element, &shape, inner, &s->next[element]);
    return true;
}

bool pm_solid_begin(pm_solid *s, const double *u, const double *inner, double *stored) {
    double sum = 0;
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double x[3 * PM_BRICK_NODES];
        pm_solid_gather(s, e, u, x);
        if (!begin_element(s, e, x, inner + inner_at(s, e), &sum)) {
            return false;
        }
    }
    *stored = sum;
    return true;
}

// The energies of a branch, J/m^3: those of pm_solid_branch_lose, and what the branch loses.
typedef struct branch_energies {
    pm_lane energy[3], lost;
} branch_energies;

// Makes sure at point p that the branch gains no energy (pm_solid_branch_lose).
static void lose(const pm_solid_branch *branch, const lane_before *before, const lane_shape *end,
                 double first, int p, pm_lane *after, branch_energies *of) {
    double Cbar[2][PM_SYM], inverse[2][PM_SYM], inner[PM_SYM], relaxed[PM_SYM], energy[3];
    for (int i = 0; i < PM_SYM; ++i) {
        Cbar[0][i] = before->Cbar[i][p];
        Cbar[1][i] = end->Cbar[i][p];
        inverse[0][i] = before->inverse[i][p];
        inverse[1][i] = end->inverse[i][p];
        inner[i] = before->inner[i][p];
        relaxed[i] = after[i][p];
    }
    const pm_solid_change change = {{Cbar[0], Cbar[1]}, {inverse[0], inverse[1]}};
    of->lost[p] = pm_solid_branch_lose(branch, &change, first, inner, relaxed, energy);
    for (int i = 0; i < PM_SYM; ++i) {
        after[i][p] = relaxed[i];
    }
    for (int k = 0; k < 3; ++k) {
        of->energy[k][p] = energy[k];
    }
}

// Computes the least of the leading minors of A = 1 + inner, all of which are positive where A is
// positive definite.
PM_LANE_FUNCTION void find_minors(const pm_lane *inner, pm_lane *minor) {
    const pm_lane a = 1 + inner[0], b = 1 + inner[1], c = 1 + inner[2];
    const pm_lane *A = inner;
    minor[0] = a;
    minor[1] = a * b - A[3] * A[3];
    minor[2] = c * minor[1] - a * A[5] * A[5] - b * A[4] * A[4] + 2 * A[3] * A[4] * A[5];
}

// Relaxes a branch to `after`, and adds its work and heat at the points, times their weights.
PM_LANE_FUNCTION void relax_branch(const pm_solid_branch *branch, const pm_solid_relaxation *step,
                                   const lane_before *before, const lane_shape *end,
                                   const double *first, pm_lane *after, pm_lane *work,
                                   pm_lane *heat) {
    branch_energies of;
    pm_lane start, minor[3];
    pm_lanes_load(1, first, &start);
    relax(branch, step, before, end, after);
    branch_energy(branch, before->Cbar, before->inverse, after, &of.energy[0]);
    branch_energy(branch, end->Cbar, end->inverse, after, &of.energy[1]);
    branch_energy(branch, end->Cbar, end->inverse, before->inner, &of.energy[2]);
    of.lost = (start - of.energy[0] + of.energy[2] - of.energy[1]) / 2;
    find_minors(after, minor);
    for (int p = 0; p < PM_BRICK_POINTS; ++p) {
        const bool good = of.lost[p] >= 0 && of.lost[p] < INFINITY && minor[0][p] > 0 &&
                          minor[1][p] > 0 && minor[2][p] > 0;
        if (!good) {
            lose(branch, before, end, first[p], p, after, &of);
        }
    }
    *heat += of.lost;
    *work += (of.energy[1] - of.energy[0] + of.energy[2] - start) / 2;
}

PM_SIMD_CLONES
static bool finish_element(pm_solid *s, int element, const pm_solid_relaxation *step,
                           const double *x, pm_solid_books *sum) {
    const pm_solid_material *material = s->material;
    const pm_solid_start *start = &s->start[element];
    pm_solid_start *next = &s->next[element];
    double *inner = s->after + inner_at(s, element);
    lane_shape shape;
    pm_lane weight, spring[2], work = {0}, heat = {0};
    if (!make_shape(&s->brick[element], x, &shape)) {
        return false;
    }
    for (int b = 0; b < material->nbranch; ++b) {
        lane_before before;
        pm_lane after[PM_SYM];
        load_before(s, element, b, &before);
        relax_branch(&material->branch[b], &step[b], &before, &shape, start->branch[b], after,
                     &work, &heat);
        scatter_tensors(after, material->nbranch * PM_SYM, inner + PM_SYM * b);
    }
    sum->stored += keep_start(s, element, &shape, inner, next);
    pm_lanes_load(1, s->brick[element].weight, &weight);
    pm_lanes_load(1, start->spring, &spring[0]);
    pm_lanes_load(1, next->spring, &spring[1]);
    work = weight * (work + (spring[1] - spring[0]));
    heat *= weight;
    sum->work += next->volume - start->volume + pm_lane_sum(&work);
    sum->heat += pm_lane_sum(&heat);
    return true;
}

bool pm_solid_finish(pm_solid *s, double h, pm_solid_books *sum) {
    pm_solid_relaxation step[PM_SOLID_MAX_BRANCHES];
    make_steps(s, h, step);
    sum->stored = sum->work = sum->heat = 0;
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double x[3 * PM_BRICK_NODES];
        pm_solid_gather(s, e, s->trial, x);
        if (!finish_element(s, e, step, x, sum)) {
            return false;
        }
    }
    return isfinite(sum->stored) && isfinite(sum->work) && isfinite(sum->heat);
}

// --- stresses ---

// Computes the mean Cauchy stress F S F^T/J over the points of an element, mean [PM_SYM].
PM_SIMD_CLONES
static void element_stress(const pm_solid *s, int element, const double *x, double *mean) {
    const pm_solid_material *material = s->material;
    const pm_brick *brick = &s->brick[element];
    const double *inner = s->inner + inner_at(s, element);
    lane_shape shape;
    pm_lane T[PM_SYM] = {{0}}, S[PM_SYM], P[9], branch[PM_SYM], weight, energy;
    double pressure;
    if (!make_shape(brick, x, &shape)) {
        return; // impossible: the state is not turned inside out
    }
    volume_energy(material, brick, &shape, &pressure);
    spring_energy(material, shape.Cbar, &energy, T);
    for (int b = 0; b < material->nbranch; ++b) {
        gather_tensors(inner + PM_SYM * b, material->nbranch * PM_SYM, branch);
        branch_stress(&material->branch[b], shape.Cbar, shape.inverse, branch, T);
    }
    second_piola(&shape, T, pressure, S);
    first_piola(&shape, S, P);
    pm_lanes_load(1, brick->weight, &weight);
    weight /= brick->volume * shape.J;
    for (int i = 0; i < PM_SYM; ++i) {
        const pm_lane *a = P + 3 * pm_sym_row[i], *b = shape.F + 3 * pm_sym_column[i];
        const pm_lane sigma = weight * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
        mean[i] = pm_lane_sum(&sigma);
    }
}

void pm_solid_stress(const pm_solid *s, double *sigma) {
    const int nnode = s->mesh->nnode;
    double *count = s->last; // [nfree] is less than [nnode] times 3
    memset(sigma, 0, PM_SYM * (size_t)nnode * sizeof *sigma);
    memset(count, 0, (size_t)nnode * sizeof *count);
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double x[3 * PM_BRICK_NODES], mean[PM_SYM] = {0};
        pm_solid_gather(s, e, s->u, x);
        element_stress(s, e, x, mean);
        for (int n = 0; n < PM_BRICK_NODES; ++n) {
            const int node = s->mesh->brick[e * PM_BRICK_NODES + n];
            ++count[node];
            for (int i = 0; i < PM_SYM; ++i) {
                sigma[PM_SYM * node + i] += mean[i];
            }
        }
    }
    for (int i = 0; i < PM_SYM * nnode; ++i) {
        sigma[i] /= count[i / PM_SYM] > 0 ? count[i / PM_SYM] : 1;
    }
}
