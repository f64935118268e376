// Finds the balance of forces: Newton's iteration with the stiffness at the start of this or an
// earlier step, improved by what the iterations have shown of the stiffness (limited-memory BFGS;
// Nocedal and Wright, Numerical Optimization, 2006, algorithm 7.4).
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model/solid/solid_parts.h"

// The iteration ends when a move is shorter than this share of the largest displacement.
#define PRECISE 3e-6
// The displacement below which a body counts as undeformed, relative to its size.
#define UNDEFORMED 1e-9
#define MOST_ITERATIONS 30
// The stiffness is assembled again after a step of more iterations than this; it takes as long as
// about five of them.
#define FEW_ITERATIONS 9
// The number of times that a move is halved because an element was turned inside out.
#define MOST_SHORTER 8
// The number of times that a step is halved because no balance was found.
#define MOST_HALVES 8
// A move this many times as long as the one before means that the stiffness is no longer right.
#define GROWTH 3

static double dot(int n, const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
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
        for (int i = 0; i < n; ++i) {
            s->move[i] -= along[k] * df[i];
        }
    }
    pm_solid_soften(s, 1, s->move);
    for (int k = 0; k < count; ++k) {
        const double *du = s->pair_u + (ptrdiff_t)k * n, *df = s->pair_f + (ptrdiff_t)k * n;
        const double back = along[k] - dot(n, df, s->move) / curvature[k];
        for (int i = 0; i < n; ++i) {
            s->move[i] += back * du[i];
        }
    }
}

// Keeps the last move and the change of the residual, if the stiffness along it is positive.
// Returns the new number of pairs.
static int keep_pair(pm_solid *s, int count) {
    const int n = s->nfree;
    const size_t size = (size_t)n * sizeof(double);
    if (count == PM_SOLID_PAIRS) {
        memmove(s->pair_u, s->pair_u + n, (size_t)(count - 1) * size);
        memmove(s->pair_f, s->pair_f + n, (size_t)(count - 1) * size);
        --count;
    }
    double *du = s->pair_u + (ptrdiff_t)count * n, *df = s->pair_f + (ptrdiff_t)count * n;
    memcpy(du, s->move, size);
    for (int i = 0; i < n; ++i) {
        df[i] = s->last[i] - s->residual[i];
    }
    return dot(n, du, df) > 0 ? count + 1 : count;
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

// Iterates s->trial from the state to balance with f, with the factor of the stiffness that there
// is. Returns false if that fails.
static bool iterate(pm_solid *s, double h, const double *f) {
    const int n = s->nfree;
    const double size = cbrt(s->brick[0].volume);
    double before = INFINITY;
    memcpy(s->trial, s->u, 3 * (size_t)s->mesh->nnode * sizeof *s->trial);
    if (!pm_solid_forces(s, h)) {
        return false;
    }
    find_residual(s, f);
    for (int k = 1; k <= MOST_ITERATIONS; ++k) {
        find_move(s, s->npair);
        const double length = longest(n, s->move);
        const double scale =
            fmax(longest(3 * s->mesh->nnode, s->trial), UNDEFORMED * size / PRECISE);
        s->books.iterations = k;
        s->books.error = length / scale;
        if (!isfinite(length) || (k > 2 && length > GROWTH * before)) {
            return false;
        }
        if (length <= PRECISE * scale) {
            for (int i = 0; i < n; ++i) {
                s->trial[s->free[i]] += s->move[i];
            }
            return true;
        }
        before = length;
        memcpy(s->last, s->residual, (size_t)n * sizeof *s->last);
        if (!move(s, h)) {
            return false;
        }
        find_residual(s, f);
        s->npair = keep_pair(s, s->npair);
    }
    return false;
}

// Does the same with the stiffness of an earlier state if the last step with it took few
// iterations, and else, or if that fails, with the stiffness of this state.
static bool balance(pm_solid *s, double h, const double *f) {
    const bool good = s->stiff_for == h && s->books.iterations <= FEW_ITERATIONS;
    return (good && iterate(s, h, f)) || (pm_solid_stiffen(s, h) && iterate(s, h, f));
}

// Takes a step, or two halves of it, which adds to the books.
static pm_status step(pm_solid *s, double h, const double *f, int halves) {
    const int n = 3 * s->mesh->nnode;
    const pm_solid_books books = s->books;
    if (balance(s, h, f) && pm_solid_follow(s, h, s->trial, NULL)) {
        s->books.work += books.work;
        s->books.heat += books.heat;
        return PM_OK;
    }
    if (halves == MOST_HALVES) {
        return pm_fail(PM_ENUMERIC, "solid: no balance of forces, not even in steps of %g s", h);
    }
    double *middle = malloc((size_t)n * sizeof *middle);
    if (middle == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a step of a solid");
    }
    memcpy(s->trial, s->u, (size_t)n * sizeof *s->trial);
    pm_solid_evaluate(s, 0, NULL); // the state is not turned inside out
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
    return step(s, h, f, 0);
}
