// A body of learned material: its state, its stiffness, and the balance of forces, which is found
// by Newton's iteration with the stiffness at the start of this or an earlier step, improved by
// what the iterations have shown of the stiffness (limited-memory BFGS; Nocedal and Wright,
// Numerical Optimization, 2006, algorithm 7.4). It starts where the last steps lead.
#include "model/solid/solid.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/band.h"
#include "base/lanes.h"
#include "base/simd.h"
#include "model/solid/solid_parts.h"

// The displacement below which a body counts as undeformed, relative to its size.
#define UNDEFORMED 1e-9
#define MOST_ITERATIONS 30
// The stiffness is assembled again after a step of more iterations than this; it takes as long as
// about five of them.
#define FEW_ITERATIONS 7
// The number of times that a move is halved because an element was turned inside out.
#define MOST_SHORTER 8
// The number of times that a step is halved because no balance was found.
#define MOST_HALVES 8
// A move this many times as long as the one before means that the stiffness is no longer right.
#define GROWTH 3

#define FREEDOMS (3 * PM_BRICK_NODES)

// --- the numbers of free components ---

// Numbers the free components so that the band is narrow, and makes the memory of the stiffness.
// The free nodes are ordered, one connected piece after the other, by their distance from a node at
// the end of the piece (Cuthill and McKee, Proc. ACM 24, 1969). PM_ECONFIG: no node is free.
static pm_status number_components(pm_solid *s) {
    const pm_solid_mesh *mesh = s->mesh;
    const size_t nnode = (size_t)mesh->nnode, ncorner = PM_BRICK_NODES * (size_t)mesh->nelement;
    const int total = (int)ncorner;
    int count = 0;
    pm_arena work = {0};
    // The elements of each node, the order of the nodes, and whether a node has been reached.
    int *first = pm_arena_array(&work, nnode + 1, sizeof *first);
    int *element = pm_arena_array(&work, ncorner, sizeof *element);
    int *order = pm_arena_array(&work, nnode, sizeof *order);
    int *reached = pm_arena_array(&work, nnode, sizeof *reached);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&work, "a solid"));
    for (int i = 0; i < total; ++i) {
        ++first[mesh->brick[i] + 1];
    }
    for (int i = 0; i < mesh->nnode; ++i) {
        first[i + 1] += first[i];
    }
    for (int i = total - 1; i >= 0; --i) {
        const int node = mesh->brick[i];
        element[first[node] + reached[node]++] = i / PM_BRICK_NODES;
    }
    memset(reached, 0, nnode * sizeof *reached);
    for (int i = 0; i < mesh->nnode; ++i) {
        if (mesh->clamped[i] || reached[i] != 0 || first[i] == first[i + 1]) {
            continue;
        }
        // The last node that is reached is at an end of the piece; start again from there.
        const int begin = count;
        for (int pass = 0; pass < 2; ++pass) {
            const int start = pass == 0 ? i : order[count - 1];
            for (int k = begin; k < count; ++k) {
                reached[order[k]] = 0;
            }
            count = begin;
            order[count++] = start;
            reached[start] = 1;
            for (int next = begin; next < count; ++next) {
                const int node = order[next];
                for (int k = PM_BRICK_NODES * first[node]; k < PM_BRICK_NODES * first[node + 1];
                     ++k) {
                    const int other =
                        mesh->brick[(ptrdiff_t)element[k / PM_BRICK_NODES] * PM_BRICK_NODES +
                                    k % PM_BRICK_NODES];
                    if (!mesh->clamped[other] && reached[other] == 0) {
                        reached[other] = 1;
                        order[count++] = other;
                    }
                }
            }
        }
    }
    // Components have the order of their nodes.
    for (int i = 0; i < mesh->nnode; ++i) {
        s->number[i] = -1;
    }
    for (int i = 0; i < count; ++i) {
        s->number[order[i]] = 3 * i;
        for (int d = 0; d < 3; ++d) {
            s->free[s->nfree++] = 3 * order[i] + d;
        }
    }
    for (int e = 0; e < mesh->nelement; ++e) {
        int low = INT_MAX, high = -1;
        for (int n = 0; n < PM_BRICK_NODES; ++n) {
            const int number = s->number[mesh->brick[e * PM_BRICK_NODES + n]];
            low = number >= 0 && number < low ? number : low;
            high = number > high ? number : high;
        }
        s->width = high >= 0 && high + 2 - low > s->width ? high + 2 - low : s->width;
    }
    if (s->nfree == 0) {
        PM_TRY_DONE(pm_fail(PM_ECONFIG, "no node of a solid is free to move"));
    }
    const size_t size = (size_t)s->nfree * (size_t)(s->width + 1);
    s->stiffness = pm_arena_array(&s->arena, size, sizeof *s->stiffness);
    s->factor = pm_arena_array(&s->arena, size, sizeof *s->factor);
    status = pm_arena_status(&s->arena, "a solid");
done:
    pm_arena_free(&work);
    return status;
}

// --- opening ---

pm_status pm_solid_open(pm_solid **solid, const pm_solid_mesh *mesh,
                        const pm_solid_material *material) {
    const size_t nelement = (size_t)mesh->nelement, n = 3 * (size_t)mesh->nnode;
    pm_status status;
    pm_solid *s = NULL;
    PM_TRY(PM_NEW(s, "a solid"));
    pm_arena *a = &s->arena;
    s->mesh = mesh;
    s->material = material;
    s->precise = PM_SOLID_PRECISE;
    s->ninner = mesh->nelement * PM_BRICK_POINTS * material->nbranch * PM_SYM;
    const size_t ninner = (size_t)s->ninner;
    s->brick = pm_arena_array(a, nelement, sizeof *s->brick);
    s->start = pm_arena_array(a, nelement, sizeof *s->start);
    s->next = pm_arena_array(a, nelement, sizeof *s->next);
    s->u = pm_arena_array(a, n, sizeof *s->u);
    s->trial = pm_arena_array(a, n, sizeof *s->trial);
    s->force = pm_arena_array(a, n, sizeof *s->force);
    s->residual = pm_arena_array(a, n, sizeof *s->residual);
    s->move = pm_arena_array(a, n, sizeof *s->move);
    s->last = pm_arena_array(a, n, sizeof *s->last);
    s->stiff_u = pm_arena_array(a, n, sizeof *s->stiff_u);
    s->past = pm_arena_array(a, PM_SOLID_PAST * n, sizeof *s->past);
    s->inner = pm_arena_array(a, ninner + 1, sizeof *s->inner);
    s->after = pm_arena_array(a, ninner + 1, sizeof *s->after);
    s->stiff_inner = pm_arena_array(a, ninner + 1, sizeof *s->stiff_inner);
    s->pair_u = pm_arena_array(a, PM_SOLID_PAIRS * n, sizeof *s->pair_u);
    s->pair_f = pm_arena_array(a, PM_SOLID_PAIRS * n, sizeof *s->pair_f);
    s->free = pm_arena_array(a, n, sizeof *s->free);
    s->number = pm_arena_array(a, n, sizeof *s->number);
    PM_TRY_DONE(pm_arena_status(a, "a solid"));
    for (int e = 0; e < mesh->nelement; ++e) {
        double x[3 * PM_BRICK_NODES];
        pm_solid_gather(s, e, mesh->position, x);
        if (!pm_brick_make(&s->brick[e], x)) {
            PM_TRY_DONE(pm_fail(PM_ECONFIG, "element %d of a solid is turned inside out", e));
        }
    }
    PM_TRY_DONE(number_components(s));
    pm_solid_set_state(s, NULL, NULL);
    *solid = s;
    s = NULL;
done:
    pm_solid_close(s);
    return status;
}

void pm_solid_close(pm_solid *solid) {
    PM_DELETE(solid);
}

// --- the state ---

const double *pm_solid_displacement(const pm_solid *s) {
    return s->u;
}

const double *pm_solid_inner(const pm_solid *s) {
    return s->inner;
}

int pm_solid_ninner(const pm_solid *s) {
    return s->ninner;
}

const pm_solid_books *pm_solid_books_of(const pm_solid *s) {
    return &s->books;
}

int pm_solid_nfree(const pm_solid *s) {
    return s->nfree;
}

const int *pm_solid_free(const pm_solid *s) {
    return s->free;
}

void pm_solid_aim(pm_solid *s, const double *guess, double precise) {
    s->guess = guess;
    s->precise = precise;
}

static void copy_or_clear(double *to, const double *from, int n) {
    if (from == NULL) {
        memset(to, 0, (size_t)n * sizeof *to);
    } else {
        memmove(to, from, (size_t)n * sizeof *to);
    }
}

// Makes s->next the start of the next step.
static void keep_next(pm_solid *s) {
    pm_solid_start *start = s->start;
    s->start = s->next;
    s->next = start;
}

bool pm_solid_return(pm_solid *s, const double *u, const double *inner) {
    const int n = 3 * s->mesh->nnode;
    copy_or_clear(s->trial, u, n);
    copy_or_clear(s->after, inner, s->ninner);
    if (!pm_solid_begin(s, s->trial, s->after, &s->books.stored)) {
        return false;
    }
    memcpy(s->u, s->trial, (size_t)n * sizeof *s->u);
    memcpy(s->inner, s->after, (size_t)s->ninner * sizeof *s->inner);
    keep_next(s);
    return true;
}

bool pm_solid_set_state(pm_solid *s, const double *u, const double *inner) {
    if (!pm_solid_return(s, u, inner)) {
        return false;
    }
    s->books = (pm_solid_books){.stored = s->books.stored};
    s->stiff_for = NAN;
    s->npast = 0;
    return true;
}

void pm_solid_record(pm_solid *s, pm_serializer *serializer) {
    double step = isnan(s->stiff_for) ? 0 : s->stiff_for;
    pm_serializer_put(serializer, "step of the stiffness", &step, 1);
    pm_serializer_put_int(serializer, "iterations", &s->books.iterations);
    pm_serializer_put_int(serializer, "past displacements", &s->npast);
    pm_serializer_put(serializer, "step between them", &s->past_for, 1);
    pm_serializer_put(serializer, "past", s->past, PM_SOLID_PAST * 3 * s->mesh->nnode);
    pm_serializer_put_int(serializer, "pairs", &s->npair);
    pm_serializer_put(serializer, "moves of the pairs", s->pair_u, PM_SOLID_PAIRS * s->nfree);
    pm_serializer_put(serializer, "forces of the pairs", s->pair_f, PM_SOLID_PAIRS * s->nfree);
    pm_serializer_put(serializer, "u of the stiffness", s->stiff_u, 3 * s->mesh->nnode);
    pm_serializer_put(serializer, "inner of the stiffness", s->stiff_inner, s->ninner);
    if (pm_serializer_restores(serializer)) {
        s->stiff_for = step == 0 ? NAN : step;
        if (step != 0) {
            // Factorise the stiffness again in the state to which it belongs.
            const int npair = s->npair;
            double *u = s->u, *inner = s->inner;
            s->u = s->stiff_u;
            s->inner = s->stiff_inner;
            pm_solid_stiffen(s, s->stiff_for);
            s->u = u;
            s->inner = inner;
            s->npair = npair;
        }
    }
}

bool pm_solid_follow(pm_solid *s, double h, const double *u, double *force) {
    const size_t n = 3 * (size_t)s->mesh->nnode;
    memmove(s->trial, u, n * sizeof *u); // u may be s->trial itself
    pm_solid_books sum = s->books;
    if (!pm_solid_finish(s, h, &sum)) {
        return false;
    }
    s->books = sum;
    memcpy(s->u, s->trial, n * sizeof *s->u);
    memcpy(s->inner, s->after, (size_t)s->ninner * sizeof *s->inner);
    keep_next(s);
    if (force != NULL) {
        pm_solid_forces(s, 0); // nothing relaxes
        memcpy(force, s->force, n * sizeof *force);
    }
    return true;
}

// --- stiffness ---

// Computes the elasticity tensor D [6][6] at a point, Pa, as if the material were linear in the
// shape with this modulus, and S, the second Piola-Kirchhoff stress. In the balance of forces it
// replaces the exact derivatives of the learned functions.
static void elasticity(const pm_solid_shape *shape, const double *T, double modulus,
                       double pressure, double *S, double D[PM_SYM][PM_SYM]) {
    double G[PM_SYM], isochoric[PM_SYM];
    const double p = pressure * shape->J;
    const double mean = pm_sym_dot(T, shape->Cbar) / 3;
    for (int i = 0; i < PM_SYM; ++i) {
        isochoric[i] = shape->factor * 2 * (T[i] - mean * shape->inverse[i]);
    }
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
        // dpsi/dCbar of all branches and the spring, without the volume.
        memset(T, 0, sizeof T);
        pm_solid_spring(material, shape[p].Cbar, T, &modulus);
        for (int b = 0; b < material->nbranch; ++b) {
            pm_solid_branch_energy(&material->branch[b], shape[p].Cbar, shape[p].inverse,
                                   s->inner + at + PM_SYM * b, T);
        }
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

// --- the balance of forces ---

PM_SIMD_CLONES
static double dot(int n, const double *a, const double *b) {
    pm_lane sum = {0};
    double rest = 0;
    int i = 0;
    for (; i + PM_LANES <= n; i += PM_LANES) {
        pm_lane x, y;
        pm_lanes_load(1, a + i, &x);
        pm_lanes_load(1, b + i, &y);
        sum += x * y;
    }
    for (; i < n; ++i) {
        rest += a[i] * b[i];
    }
    return pm_lane_sum(&sum) + rest;
}

// Adds a times x to y.
PM_SIMD_CLONES
static void add(int n, double a, const double *restrict x, double *restrict y) {
    for (int i = 0; i < n; ++i) {
        y[i] += a * x[i];
    }
}

static double longest(int n, const double *x) {
    double most = 0;
    for (int i = 0; i < n; ++i) {
        most = fmax(most, fabs(x[i]));
    }
    return most;
}

// Computes the residual f - dE/du of the free components.
static void find_residual(pm_solid *s, const double *f) {
    for (int i = 0; i < s->nfree; ++i) {
        s->residual[i] = f[s->free[i]] - s->force[s->free[i]];
    }
}

// Computes s->move from the residual, with `count` pairs of moves and changes of the residual.
static void find_move(pm_solid *s, int count) {
    const int n = s->nfree;
    double along[PM_SOLID_PAIRS], curvature[PM_SOLID_PAIRS];
    memcpy(s->move, s->residual, (size_t)n * sizeof *s->move);
    for (int k = count - 1; k >= 0; --k) {
        const double *du = s->pair_u + (ptrdiff_t)k * n, *df = s->pair_f + (ptrdiff_t)k * n;
        curvature[k] = dot(n, du, df);
        along[k] = dot(n, du, s->move) / curvature[k];
        add(n, -along[k], df, s->move);
    }
    pm_solid_soften(s, 1, s->move);
    for (int k = 0; k < count; ++k) {
        const double *du = s->pair_u + (ptrdiff_t)k * n, *df = s->pair_f + (ptrdiff_t)k * n;
        add(n, along[k] - dot(n, df, s->move) / curvature[k], du, s->move);
    }
}

// Moves s->trial, less far if an element would be turned inside out, and evaluates the elements.
static bool move(pm_solid *s, double h) {
    for (int k = 0; k <= MOST_SHORTER; ++k) {
        for (int i = 0; i < s->nfree; ++i) {
            s->trial[s->free[i]] += s->move[i];
        }
        if (pm_solid_forces(s, h)) {
            return true;
        }
        for (int i = 0; i < s->nfree; ++i) {
            s->trial[s->free[i]] -= s->move[i];
            s->move[i] /= 2;
        }
    }
    return false;
}

// Computes the start of the iteration: the guess of the caller, or the displacements that continue
// those of the last steps as a parabola, or the state, where these are not known or would turn an
// element inside out.
static bool predict(pm_solid *s, double h) {
    const int n = 3 * s->mesh->nnode;
    const double *now = s->past, *last = s->past + n, *before = s->past + 2 * (ptrdiff_t)n;
    if (s->guess != NULL) {
        memcpy(s->trial, s->guess, (size_t)n * sizeof *s->trial);
        return pm_solid_forces(s, h);
    }
    memcpy(s->trial, s->u, (size_t)n * sizeof *s->trial);
    if (s->past_for == h && s->npast == PM_SOLID_PAST) {
        for (int i = 0; i < n; ++i) {
            s->trial[i] += 2 * now[i] - 3 * last[i] + before[i];
        }
        if (pm_solid_forces(s, h)) {
            return true;
        }
        memcpy(s->trial, s->u, (size_t)n * sizeof *s->trial);
    }
    return pm_solid_forces(s, h);
}

// Iterates s->trial to balance with f, with the factor of the stiffness that there is. Returns
// false if that fails.
static bool iterate(pm_solid *s, double h, const double *f) {
    const int n = s->nfree;
    const size_t all = (size_t)n * sizeof(double);
    const double size = cbrt(s->brick[0].volume);
    double before = INFINITY;
    if (!predict(s, h)) {
        return false;
    }
    find_residual(s, f);
    for (int k = 1; k <= MOST_ITERATIONS; ++k) {
        find_move(s, s->npair);
        const double length = longest(n, s->move);
        const double scale =
            fmax(longest(3 * s->mesh->nnode, s->trial), UNDEFORMED * size / s->precise);
        s->books.iterations = k;
        s->books.error = length / scale;
        if (!isfinite(length) || (k > 2 && length > GROWTH * before)) {
            return false;
        }
        if (length <= s->precise * scale) {
            for (int i = 0; i < n; ++i) {
                s->trial[s->free[i]] += s->move[i];
            }
            return true;
        }
        before = length;
        memcpy(s->last, s->residual, all);
        if (!move(s, h)) {
            return false;
        }
        find_residual(s, f);
        // Keep the move and the change of the residual, if the stiffness along it is positive.
        if (s->npair == PM_SOLID_PAIRS) {
            memmove(s->pair_u, s->pair_u + n, (size_t)(s->npair - 1) * all);
            memmove(s->pair_f, s->pair_f + n, (size_t)(s->npair - 1) * all);
            --s->npair;
        }
        double *du = s->pair_u + (ptrdiff_t)s->npair * n, *df = s->pair_f + (ptrdiff_t)s->npair * n;
        memcpy(du, s->move, all);
        for (int i = 0; i < n; ++i) {
            df[i] = s->last[i] - s->residual[i];
        }
        s->npair += dot(n, du, df) > 0;
    }
    return false;
}

// Takes a step, or two halves of it, which adds to the books.
static pm_status step(pm_solid *s, double h, const double *f, int halves) {
    const int n = 3 * s->mesh->nnode;
    const pm_solid_books books = s->books;
    // The stiffness of an earlier state serves if the last step with it took few iterations; else,
    // or if that fails, that of this state; at last without a prediction.
    const bool good = s->stiff_for == h && s->books.iterations <= FEW_ITERATIONS;
    bool found = (good && iterate(s, h, f)) || (pm_solid_stiffen(s, h) && iterate(s, h, f));
    if (!found) {
        const bool predicted = s->npast == PM_SOLID_PAST;
        s->npast = 0;
        found = predicted && pm_solid_stiffen(s, h) && iterate(s, h, f);
    }
    if (found && pm_solid_follow(s, h, s->trial, NULL)) {
        s->books.work += books.work;
        s->books.heat += books.heat;
        return PM_OK;
    }
    s->guess = NULL; // it belongs to the whole step
    if (halves == MOST_HALVES) {
        return pm_fail(PM_ENUMERIC, "solid: no balance of forces, not even in steps of %g s", h);
    }
    double *middle = malloc((size_t)n * sizeof *middle);
    PM_TRY(pm_allocated(middle, "a step of a solid"));
    memcpy(s->trial, s->u, (size_t)n * sizeof *s->trial);
    pm_solid_forces(s, 0); // the state is not turned inside out
    for (int i = 0; i < n; ++i) {
        middle[i] = (s->force[i] + f[i]) / 2;
    }
    pm_status status = step(s, h / 2, middle, halves + 1);
    if (status == PM_OK) {
        status = step(s, h / 2, f, halves + 1);
    }
    free(middle);
    return status;
}

pm_status pm_solid_step(pm_solid *s, double h, const double *f) {
    s->books.work = s->books.heat = 0;
    // Note the displacements at the start of the step, unless it is taken once more.
    const size_t n = 3 * (size_t)s->mesh->nnode;
    if (s->npast == 0 || memcmp(s->past, s->u, n * sizeof *s->u) != 0) {
        s->npast = s->past_for != h ? 1 : s->npast < PM_SOLID_PAST ? s->npast + 1 : s->npast;
        s->past_for = h;
        memmove(s->past + n, s->past, (PM_SOLID_PAST - 1) * n * sizeof *s->past);
        memcpy(s->past, s->u, n * sizeof *s->u);
    }
    return step(s, h, f, 0);
}
