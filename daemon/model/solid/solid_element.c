// Evaluates all elements of a body: forces, energies, stresses.
#include <string.h>

#include "model/solid/solid_parts.h"

void pm_solid_gather(const pm_solid *s, int element, const double *u, double *x) {
    const int *node = s->mesh->brick + (ptrdiff_t)element * PM_BRICK_NODES;
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        memcpy(x + 3 * n, u + 3 * (ptrdiff_t)node[n], 3 * sizeof *x);
    }
}

// Returns the place of the inner variables of a point in an array of all.
static ptrdiff_t inner_at(const pm_solid *s, int element, int point) {
    return ((ptrdiff_t)element * PM_BRICK_POINTS + point) * s->material->nbranch * PM_SYM;
}

// Computes the shapes at all points of an element and its relative volume. Returns false if it is
// turned inside out.
static bool shape_element(const pm_solid *s, int element, const double *u, pm_solid_shape *shape,
                          double *J) {
    const pm_brick *brick = &s->brick[element];
    double x[3 * PM_BRICK_NODES], F[PM_BRICK_POINTS][9], volume = 0;
    pm_solid_gather(s, element, u, x);
    pm_brick_deform(brick, x, F);
    for (int p = 0; p < PM_BRICK_POINTS; ++p) {
        memcpy(shape[p].F, F[p], sizeof F[p]);
        if (!pm_solid_shape_make(&shape[p])) {
            return false;
        }
        volume += brick->weight[p] * shape[p].J;
    }
    *J = volume / brick->volume;
    return true;
}

void pm_solid_point_stress(const pm_solid *s, const pm_solid_shape *shape, const double *inner,
                           double *T, double *modulus) {
    memset(T, 0, PM_SYM * sizeof *T);
    pm_solid_spring(s->material, shape->Cbar, T, modulus);
    for (int b = 0; b < s->material->nbranch; ++b) {
        pm_solid_branch_energy(&s->material->branch[b], shape->Cbar, shape->inverse,
                               inner + PM_SYM * b, T);
    }
}

void pm_solid_piola(const pm_solid_shape *shape, const double *T, double pressure, double *S) {
    const double mean = pm_sym_dot(T, shape->Cbar) / 3;
    for (int i = 0; i < PM_SYM; ++i) {
        S[i] = shape->factor *
               (2 * (T[i] - mean * shape->inverse[i]) + pressure * shape->J * shape->inverse[i]);
    }
}

// Relaxes the branches of a point from `before` to `after`. If `sums` is not NULL, it adds their
// work and heat, and the work of the spring, times the weight of the point.
static void relax_point(const pm_solid *s, const pm_solid_relaxation *step,
                        const pm_solid_start *start, int p, const pm_solid_shape *shape,
                        const double *before, double *after, double weight, pm_solid_sums *sums) {
    double Cbar[PM_SYM], inverse[PM_SYM];
    for (int i = 0; i < PM_SYM; ++i) {
        Cbar[i] = start->Cbar[i][p];
        inverse[i] = start->inverse[i][p];
    }
    const pm_solid_change change = {{Cbar, shape->Cbar}, {inverse, shape->inverse}};
    if (sums != NULL) {
        const double spring = pm_solid_spring(s->material, shape->Cbar, NULL, NULL);
        sums->work += weight * (spring - start->spring[p]);
    }
    for (int b = 0; b < s->material->nbranch; ++b) {
        const pm_solid_branch *branch = &s->material->branch[b];
        double energy[3], *A = after + PM_SYM * b;
        pm_solid_branch_relax(branch, &step[b], &change, before + PM_SYM * b, A);
        if (sums != NULL) {
            sums->heat += weight * pm_solid_branch_lose(branch, &change, start->branch[b][p],
                                                        before + PM_SYM * b, A, energy);
            sums->work += weight * (energy[1] - energy[0] + energy[2] - start->branch[b][p]) / 2;
        }
    }
}

// Adds the forces of a point to those of the element, force [PM_BRICK_NODES][3].
static void add_force(const pm_brick *brick, int p, const pm_solid_shape *shape, const double *S,
                      double *force) {
    double P[9]; // first Piola-Kirchhoff stress F S, times the weight of the point
    for (int i = 0; i < 9; ++i) {
        const double *F = shape->F + i / 3 * 3;
        const int *at = pm_sym_at[i % 3];
        P[i] = brick->weight[p] * (F[0] * S[at[0]] + F[1] * S[at[1]] + F[2] * S[at[2]]);
    }
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        const double(*g)[PM_BRICK_POINTS] = brick->gradient[n];
        for (int i = 0; i < 3; ++i) {
            force[3 * n + i] +=
                P[3 * i] * g[0][p] + P[3 * i + 1] * g[1][p] + P[3 * i + 2] * g[2][p];
        }
    }
}

bool pm_solid_evaluate(pm_solid *s, double h, pm_solid_sums *sums) {
    pm_solid_shape shape[PM_BRICK_POINTS];
    pm_solid_relaxation step[PM_SOLID_MAX_BRANCHES];
    for (int b = 0; b < s->material->nbranch; ++b) {
        step[b] = pm_solid_branch_relaxation(&s->material->branch[b], h);
    }
    memset(s->force, 0, 3 * (size_t)s->mesh->nnode * sizeof *s->force);
    if (sums != NULL) {
        *sums = (pm_solid_sums){0};
    }
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double force[3 * PM_BRICK_NODES] = {0}, J, pressure, modulus = 0;
        const pm_brick *brick = &s->brick[e];
        if (!shape_element(s, e, s->trial, shape, &J)) {
            return false;
        }
        const double volume = brick->volume * pm_solid_volume(s->material, J, &pressure, &modulus);
        if (sums != NULL) {
            sums->work += volume - s->volume_energy[e];
        }
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            const ptrdiff_t at = inner_at(s, e, p);
            double T[PM_SYM], S[PM_SYM];
            relax_point(s, step, &s->start[e], p, &shape[p], s->inner + at, s->after + at,
                        brick->weight[p], sums);
            pm_solid_point_stress(s, &shape[p], s->after + at, T, &modulus);
            pm_solid_piola(&shape[p], T, pressure, S);
            add_force(brick, p, &shape[p], S, force);
        }
        const int *node = s->mesh->brick + (ptrdiff_t)e * PM_BRICK_NODES;
        for (int i = 0; i < 3 * PM_BRICK_NODES; ++i) {
            s->force[3 * node[i / 3] + i % 3] += force[i];
        }
    }
    return true;
}

double pm_solid_begin(pm_solid *s) {
    pm_solid_shape shape[PM_BRICK_POINTS];
    double stored = 0;
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double J = 1, pressure, modulus, energy = 0;
        shape_element(s, e, s->u, shape, &J);
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            pm_solid_start *start = &s->start[e];
            const double *inner = s->inner + inner_at(s, e, p);
            for (int i = 0; i < PM_SYM; ++i) {
                start->Cbar[i][p] = shape[p].Cbar[i];
                start->inverse[i][p] = shape[p].inverse[i];
            }
            double psi = pm_solid_spring(s->material, shape[p].Cbar, NULL, NULL);
            start->spring[p] = psi;
            for (int b = 0; b < s->material->nbranch; ++b) {
                start->branch[b][p] =
                    pm_solid_branch_energy(&s->material->branch[b], shape[p].Cbar, shape[p].inverse,
                                           inner + PM_SYM * b, NULL);
                psi += start->branch[b][p];
            }
            energy += s->brick[e].weight[p] * psi;
        }
        s->volume_energy[e] =
            s->brick[e].volume * pm_solid_volume(s->material, J, &pressure, &modulus);
        stored += energy + s->volume_energy[e];
    }
    return stored;
}

// Adds the Cauchy stress F S F^T/J of a point, times the share of the point, to sigma [PM_SYM].
static void add_cauchy(const pm_solid_shape *shape, const double *S, double share, double *sigma) {
    double P[9];
    for (int i = 0; i < 9; ++i) {
        const double *F = shape->F + i / 3 * 3;
        const int *at = pm_sym_at[i % 3];
        P[i] = F[0] * S[at[0]] + F[1] * S[at[1]] + F[2] * S[at[2]];
    }
    for (int i = 0; i < PM_SYM; ++i) {
        const double *a = P + 3 * pm_sym_row[i], *b = shape->F + 3 * pm_sym_column[i];
        sigma[i] += share / shape->J * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
    }
}

void pm_solid_stress(const pm_solid *s, double *sigma) {
    pm_solid_shape shape[PM_BRICK_POINTS];
    const int nnode = s->mesh->nnode;
    double *count = s->last; // [nfree] is less than [nnode] times 3
    memset(sigma, 0, PM_SYM * (size_t)nnode * sizeof *sigma);
    memset(count, 0, (size_t)nnode * sizeof *count);
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double mean[PM_SYM] = {0}, J = 1, pressure, modulus = 0;
        shape_element(s, e, s->u, shape, &J);
        pm_solid_volume(s->material, J, &pressure, &modulus);
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            double T[PM_SYM], S[PM_SYM];
            pm_solid_point_stress(s, &shape[p], s->inner + inner_at(s, e, p), T, &modulus);
            pm_solid_piola(&shape[p], T, pressure, S);
            add_cauchy(&shape[p], S, s->brick[e].weight[p] / s->brick[e].volume, mean);
        }
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
