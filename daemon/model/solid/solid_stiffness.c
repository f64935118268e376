// Numbers the free components of a body, and assembles and factorises its stiffness.
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/band.h"
#include "model/solid/solid_parts.h"

#define FREEDOMS (3 * PM_BRICK_NODES)

// --- numbering ---

// The elements of each node, and the work space of the numbering.
typedef struct node_graph {
    const pm_solid_mesh *mesh;
    int *first, *element; // [nnode + 1], [PM_BRICK_NODES nelement]
    int *order, *level;   // [nnode]
} node_graph;

static void find_elements(node_graph *g) {
    const int total = PM_BRICK_NODES * g->mesh->nelement;
    for (int i = 0; i < total; ++i) {
        ++g->first[g->mesh->brick[i] + 1];
    }
    for (int i = 0; i < g->mesh->nnode; ++i) {
        g->first[i + 1] += g->first[i];
    }
    for (int i = total - 1; i >= 0; --i) {
        const int node = g->mesh->brick[i];
        g->element[g->first[node] + g->level[node]++] = i / PM_BRICK_NODES;
    }
}

// Lists the free nodes that are reached from `start` in the order of their distance, and returns
// their number. level[] becomes 1 at all nodes that were listed, and 0 elsewhere was required.
static int spread(node_graph *g, int start, int count) {
    int next = count;
    g->order[count++] = start;
    g->level[start] = 1;
    for (; next < count; ++next) {
        const int node = g->order[next];
        for (int k = g->first[node]; k < g->first[node + 1]; ++k) {
            const int *other = g->mesh->brick + (ptrdiff_t)g->element[k] * PM_BRICK_NODES;
            for (int n = 0; n < PM_BRICK_NODES; ++n) {
                if (!g->mesh->clamped[other[n]] && g->level[other[n]] == 0) {
                    g->level[other[n]] = 1;
                    g->order[count++] = other[n];
                }
            }
        }
    }
    return count;
}

// Orders the free nodes, one connected piece after the other, by their distance from a node at the
// end of the piece (Cuthill and McKee, Proc. ACM 24, 1969). Returns their number.
static int order_nodes(node_graph *g) {
    int count = 0;
    memset(g->level, 0, (size_t)g->mesh->nnode * sizeof *g->level);
    for (int i = 0; i < g->mesh->nnode; ++i) {
        if (g->mesh->clamped[i] || g->level[i] != 0 || g->first[i] == g->first[i + 1]) {
            continue;
        }
        // The last node that is reached is at an end of the piece; start again from there.
        const int first = count;
        for (int pass = 0; pass < 2; ++pass) {
            const int start = pass == 0 ? i : g->order[count - 1];
            for (int k = first; k < count; ++k) {
                g->level[g->order[k]] = 0;
            }
            count = spread(g, start, first);
        }
    }
    return count;
}

// Numbers the components in the order of their nodes, and finds the width of the band.
static void number_components(pm_solid *s, const node_graph *g, int count) {
    for (int i = 0; i < s->mesh->nnode; ++i) {
        s->number[i] = -1;
    }
    for (int i = 0; i < count; ++i) {
        s->number[g->order[i]] = 3 * i;
        for (int d = 0; d < 3; ++d) {
            s->free[s->nfree++] = 3 * g->order[i] + d;
        }
    }
    for (int e = 0; e < s->mesh->nelement; ++e) {
        int low = INT_MAX, high = -1;
        for (int n = 0; n < PM_BRICK_NODES; ++n) {
            const int number = s->number[s->mesh->brick[e * PM_BRICK_NODES + n]];
            low = number >= 0 && number < low ? number : low;
            high = number > high ? number : high;
        }
        s->width = high >= 0 && high + 2 - low > s->width ? high + 2 - low : s->width;
    }
}

pm_status pm_solid_number(pm_solid *s) {
    const size_t nnode = (size_t)s->mesh->nnode;
    int *memory =
        calloc(3 * nnode + 1 + PM_BRICK_NODES * (size_t)s->mesh->nelement, sizeof *memory);
    if (memory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a solid");
    }
    node_graph g = {s->mesh, memory, memory + 3 * nnode + 1, memory + nnode + 1,
                    memory + 2 * nnode + 1};
    find_elements(&g);
    number_components(s, &g, order_nodes(&g));
    free(memory);
    if (s->nfree == 0) {
        return pm_fail(PM_ECONFIG, "no node of a solid is free to move");
    }
    const size_t size = (size_t)s->nfree * (size_t)(s->width + 1);
    s->stiffness = pm_arena_array(&s->arena, size, sizeof *s->stiffness);
    s->factor = pm_arena_array(&s->arena, size, sizeof *s->factor);
    return s->stiffness == NULL || s->factor == NULL
               ? pm_fail(PM_ENOMEM, "out of memory for a solid")
               : PM_OK;
}

// --- assembly ---

// Computes dpsi/dCbar of all branches and the spring at a point, without the volume, and adds the
// modulus there.
static void point_stress(const pm_solid *s, const pm_solid_shape *shape, const double *inner,
                         double *T, double *modulus) {
    memset(T, 0, PM_SYM * sizeof *T);
    pm_solid_spring(s->material, shape->Cbar, T, modulus);
    for (int b = 0; b < s->material->nbranch; ++b) {
        pm_solid_branch_energy(&s->material->branch[b], shape->Cbar, shape->inverse,
                               inner + PM_SYM * b, T);
    }
}

// Computes the part of the second Piola-Kirchhoff stress without the volume from T, Pa.
static void isochoric_stress(const pm_solid_shape *shape, const double *T, double *S) {
    const double mean = pm_sym_dot(T, shape->Cbar) / 3;
    for (int i = 0; i < PM_SYM; ++i) {
        S[i] = shape->factor * 2 * (T[i] - mean * shape->inverse[i]);
    }
}

// Computes the elasticity tensor D [6][6] at a point, Pa, as if the material were linear in the
// shape with this modulus, and S, the second Piola-Kirchhoff stress. In the balance of forces it
// replaces the exact derivatives of the learned functions.
static void elasticity(const pm_solid_shape *shape, const double *T, double modulus,
                       double pressure, double *S, double D[PM_SYM][PM_SYM]) {
    double G[PM_SYM], isochoric[PM_SYM];
    const double p = pressure * shape->J;
    isochoric_stress(shape, T, isochoric);
    for (int i = 0; i < PM_SYM; ++i) {
        G[i] = shape->factor * shape->inverse[i];
        S[i] = isochoric[i] + p * G[i];
    }
    for (int m = 0; m < PM_SYM; ++m) {
        const int i = pm_sym_row[m], j = pm_sym_column[m];
        for (int n = 0; n < PM_SYM; ++n) {
            const int k = pm_sym_row[n], l = pm_sym_column[n];
            const double cross = (G[pm_sym_at[i][k]] * G[pm_sym_at[j][l]] +
                                  G[pm_sym_at[i][l]] * G[pm_sym_at[j][k]]) /
                                 2;
            D[m][n] = 2 * modulus * (cross - G[m] * G[n] / 3) -
                      2.0 / 3 * (G[m] * isochoric[n] + isochoric[m] * G[n]) +
                      p * (G[m] * G[n] - 2 * cross);
        }
    }
}

// Adds B^T D B and the stiffness of the stress S at a point, with its weight, to the lower triangle
// of K, and to `growth` the derivative of the element's volume.
static void add_point(const pm_brick *brick, int p, const pm_solid_shape *shape, const double *S,
                      double D[PM_SYM][PM_SYM], double K[FREEDOMS][FREEDOMS], double *growth) {
    double B[FREEDOMS][PM_SYM], DB[FREEDOMS][PM_SYM];
    const double weight = brick->weight[p];
    for (int a = 0; a < FREEDOMS; ++a) {
        const double(*gradient)[PM_BRICK_POINTS] = brick->gradient[a / 3];
        const double g[3] = {gradient[0][p], gradient[1][p], gradient[2][p]},
                     *F = shape->F + a % 3 * 3;
        for (int m = 0; m < PM_SYM; ++m) {
            const int i = pm_sym_row[m], j = pm_sym_column[m];
            B[a][m] = i == j ? F[i] * g[i] : F[i] * g[j] + F[j] * g[i];
        }
        double sum = 0;
        for (int m = 0; m < PM_SYM; ++m) {
            DB[a][m] = 0;
            for (int n = 0; n < PM_SYM; ++n) {
                DB[a][m] += weight * D[m][n] * B[a][n];
            }
            sum += shape->inverse[m] * B[a][m];
        }
        growth[a] += weight * shape->J * shape->factor * sum;
    }
    for (int a = 0; a < FREEDOMS; ++a) {
        for (int b = 0; b <= a; ++b) {
            double sum = 0;
            for (int m = 0; m < PM_SYM; ++m) {
                sum += DB[a][m] * B[b][m];
            }
            K[a][b] += sum;
        }
    }
    for (int a = 0; a < PM_BRICK_NODES; ++a) {
        const double(*of_a)[PM_BRICK_POINTS] = brick->gradient[a];
        const double g[3] = {of_a[0][p], of_a[1][p], of_a[2][p]};
        for (int b = 0; b <= a; ++b) {
            const double(*of_b)[PM_BRICK_POINTS] = brick->gradient[b];
            const double h[3] = {of_b[0][p], of_b[1][p], of_b[2][p]};
            double sum = 0;
            for (int i = 0; i < 3; ++i) {
                const int *at = pm_sym_at[i];
                sum += weight * g[i] * (S[at[0]] * h[0] + S[at[1]] * h[1] + S[at[2]] * h[2]);
            }
            for (int i = 0; i < 3; ++i) {
                K[3 * a + i][3 * b + i] += sum;
            }
        }
    }
}

// Computes the lower triangle of an element's stiffness for steps of h s, with the stiffness of its
// stress if `stressed`.
static void stiffen_element(const pm_solid *s, int e, double h, bool stressed,
                            double K[FREEDOMS][FREEDOMS]) {
    const pm_brick *brick = &s->brick[e];
    const pm_solid_material *material = s->material;
    pm_solid_shape shape[PM_BRICK_POINTS];
    double x[FREEDOMS], J = 0, growth[FREEDOMS] = {0}, pressure, bulk, branches = 0;
    memset(K, 0, FREEDOMS * sizeof *K);
    double F[PM_BRICK_POINTS][9];
    pm_solid_gather(s, e, s->u, x);
    pm_brick_deform(brick, x, F);
    for (int p = 0; p < PM_BRICK_POINTS; ++p) {
        memcpy(shape[p].F, F[p], sizeof F[p]);
        pm_solid_shape_make(&shape[p]); // the state is not turned inside out
        J += brick->weight[p] * shape[p].J / brick->volume;
    }
    pm_solid_volume(material, J, &pressure, &bulk);
    for (int b = 0; b < material->nbranch; ++b) {
        branches += pm_solid_branch_modulus(&material->branch[b], h);
    }
    for (int p = 0; p < PM_BRICK_POINTS; ++p) {
        const ptrdiff_t at = ((ptrdiff_t)e * PM_BRICK_POINTS + p) * material->nbranch * PM_SYM;
        double T[PM_SYM], S[PM_SYM], D[PM_SYM][PM_SYM], modulus = branches;
        point_stress(s, &shape[p], s->inner + at, T, &modulus);
        if (!stressed) {
            memset(T, 0, sizeof T);
        }
        elasticity(&shape[p], T, modulus, stressed ? pressure : 0, S, D);
        add_point(brick, p, &shape[p], S, D, K, growth);
    }
    for (int a = 0; a < FREEDOMS; ++a) {
        for (int b = 0; b <= a; ++b) {
            K[a][b] += bulk / brick->volume * growth[a] * growth[b];
        }
    }
}

static bool stiffen(pm_solid *s, double h, bool stressed) {
    double K[FREEDOMS][FREEDOMS];
    const ptrdiff_t rows = s->width + 1;
    memset(s->stiffness, 0, (size_t)s->nfree * (size_t)rows * sizeof *s->stiffness);
    for (int e = 0; e < s->mesh->nelement; ++e) {
        const int *node = s->mesh->brick + (ptrdiff_t)e * PM_BRICK_NODES;
        stiffen_element(s, e, h, stressed, K);
        for (int a = 0; a < FREEDOMS; ++a) {
            const int i = s->number[node[a / 3]];
            for (int b = 0; b <= a && i >= 0; ++b) {
                const int j = s->number[node[b / 3]];
                if (j >= 0) {
                    const int row = i + a % 3, column = j + b % 3;
                    const int low = row < column ? row : column;
                    s->stiffness[low * rows + (row > column ? row : column) - low] += K[a][b];
                }
            }
        }
    }
    return pm_band_factor(s->nfree, s->width, s->stiffness, s->factor);
}

bool pm_solid_stiffen(pm_solid *s, double h) {
    const bool good = stiffen(s, h, true) || stiffen(s, h, false);
    s->stiff_for = good ? h : NAN;
    s->npair = 0;
    memmove(s->stiff_u, s->u, 3 * (size_t)s->mesh->nnode * sizeof *s->u);
    memmove(s->stiff_inner, s->inner, (size_t)s->ninner * sizeof *s->inner);
    return good;
}

void pm_solid_soften(const pm_solid *s, int count, double *x) {
    for (int i = 0; i < count; ++i) {
        pm_band_solve(s->nfree, s->width, s->factor, x + (ptrdiff_t)i * s->nfree);
    }
}
