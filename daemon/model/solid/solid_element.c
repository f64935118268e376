// Evaluates all elements of a body: forces, energies and stresses.
#include <math.h>
#include <string.h>

#include "base/simd.h"
#include "model/solid/solid_lanes.h"

void pm_solid_gather(const pm_solid *s, int element, const double *u, double *x) {
    const int *node = s->mesh->brick + (ptrdiff_t)element * PM_BRICK_NODES;
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        memcpy(x + 3 * n, u + 3 * (ptrdiff_t)node[n], 3 * sizeof *x);
    }
}

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
PM_LANE_FUNCTION void load_before(const pm_solid *s, int element, int b, pm_lane_before *before) {
    const pm_solid_start *start = &s->start[element];
    const ptrdiff_t stride = s->material->nbranch * PM_SYM;
    pm_lanes_load(PM_SYM, start->Cbar[0], before->Cbar);
    pm_lanes_load(PM_SYM, start->inverse[0], before->inverse);
    pm_lanes_gather(s->inner + inner_at(s, element) + PM_SYM * b, stride, before->inner);
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
    pm_lane_shape shape;
    pm_lane T[PM_SYM] = {{0}}, S[PM_SYM], P[9], energy;
    double pressure;
    if (!pm_lane_shape_make(brick, x, &shape)) {
        return false;
    }
    pm_lane_volume(material, brick, &shape, &pressure);
    pm_lane_spring(material, shape.Cbar, &energy, T);
    for (int b = 0; b < material->nbranch; ++b) {
        pm_lane_before before;
        pm_lane after[PM_SYM];
        load_before(s, element, b, &before);
        pm_lane_relax(&material->branch[b], &step[b], &before, &shape, after);
        pm_lane_branch_stress(&material->branch[b], shape.Cbar, shape.inverse, after, T);
    }
    pm_lane_piola(&shape, T, pressure, S);
    pm_lane_first_piola(&shape, S, P);
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
PM_LANE_FUNCTION double keep_start(const pm_solid *s, int element, const pm_lane_shape *shape,
                                   const double *inner, pm_solid_start *start) {
    const pm_solid_material *material = s->material;
    const pm_brick *brick = &s->brick[element];
    pm_lane weight, psi, ignored[PM_SYM] = {{0}}, branch[PM_SYM], energy;
    double pressure;
    pm_lanes_load(1, brick->weight, &weight);
    pm_lanes_store(PM_SYM, shape->Cbar, start->Cbar[0]);
    pm_lanes_store(PM_SYM, shape->inverse, start->inverse[0]);
    start->volume = pm_lane_volume(material, brick, shape, &pressure);
    pm_lane_spring(material, shape->Cbar, &psi, ignored);
    pm_lanes_store(1, &psi, start->spring);
    for (int b = 0; b < material->nbranch; ++b) {
        pm_lanes_gather(inner + PM_SYM * b, material->nbranch * PM_SYM, branch);
        pm_lane_branch_energy(&material->branch[b], shape->Cbar, shape->inverse, branch, &energy);
        pm_lanes_store(1, &energy, start->branch[b]);
        psi += energy;
    }
    psi *= weight;
    return start->volume + pm_lane_sum(&psi);
}

PM_SIMD_CLONES
static bool begin_element(pm_solid *s, int element, const double *x, const double *inner,
                          double *stored) {
    pm_lane_shape shape;
    if (!pm_lane_shape_make(&s->brick[element], x, &shape)) {
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
static void lose(const pm_solid_branch *branch, const pm_lane_before *before,
                 const pm_lane_shape *end, double first, int p, pm_lane *after,
                 branch_energies *of) {
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
                                   const pm_lane_before *before, const pm_lane_shape *end,
                                   const double *first, pm_lane *after, pm_lane *work,
                                   pm_lane *heat) {
    branch_energies of;
    pm_lane start, minor[3];
    pm_lanes_load(1, first, &start);
    pm_lane_relax(branch, step, before, end, after);
    pm_lane_branch_energy(branch, before->Cbar, before->inverse, after, &of.energy[0]);
    pm_lane_branch_energy(branch, end->Cbar, end->inverse, after, &of.energy[1]);
    pm_lane_branch_energy(branch, end->Cbar, end->inverse, before->inner, &of.energy[2]);
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
    pm_lane_shape shape;
    pm_lane weight, spring[2], work = {0}, heat = {0};
    if (!pm_lane_shape_make(&s->brick[element], x, &shape)) {
        return false;
    }
    for (int b = 0; b < material->nbranch; ++b) {
        pm_lane_before before;
        pm_lane after[PM_SYM];
        load_before(s, element, b, &before);
        relax_branch(&material->branch[b], &step[b], &before, &shape, start->branch[b], after,
                     &work, &heat);
        pm_lanes_scatter(after, material->nbranch * PM_SYM, inner + PM_SYM * b);
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
    pm_lane_shape shape;
    pm_lane T[PM_SYM] = {{0}}, S[PM_SYM], P[9], branch[PM_SYM], weight, energy;
    double pressure;
    if (!pm_lane_shape_make(brick, x, &shape)) {
        return; // impossible: the state is not turned inside out
    }
    pm_lane_volume(material, brick, &shape, &pressure);
    pm_lane_spring(material, shape.Cbar, &energy, T);
    for (int b = 0; b < material->nbranch; ++b) {
        pm_lanes_gather(inner + PM_SYM * b, material->nbranch * PM_SYM, branch);
        pm_lane_branch_stress(&material->branch[b], shape.Cbar, shape.inverse, branch, T);
    }
    pm_lane_piola(&shape, T, pressure, S);
    pm_lane_first_piola(&shape, S, P);
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
