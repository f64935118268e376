// Finds the balance of forces: Newton's iteration with the stiffness at the start of this or an
// earlier step, improved by what the iterations have shown of the stiffness (limited-memory BFGS;
// Nocedal and Wright, Numerical Optimization, 2006, algorithm 7.4). It starts where the last steps
// lead.
#include <math.h>
#include <stdlib.h>
#include <string.h>

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

// Notes the displacements at the start of a step of h s, unless the step is taken once more.
static void note_start(pm_solid *s, double h) {
    const size_t n = 3 * (size_t)s->mesh->nnode;
    if (s->npast > 0 && memcmp(s->past, s->u, n * sizeof *s->u) == 0) {
        return;
    }
    const bool same = s->past_for == h;
    s->npast = same && s->npast < PM_SOLID_PAST ? s->npast + 1 : same ? s->npast : 1;
    s->past_for = h;
    memmove(s->past + n, s->past, (PM_SOLID_PAST - 1) * n * sizeof *s->past);
    memcpy(s->past, s->u, n * sizeof *s->u);
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
// iterations, and else, or if that fails, with the stiffness of this state; at last without a
// prediction.
static bool balance(pm_solid *s, double h, const double *f) {
    const bool good = s->stiff_for == h && s->books.iterations <= FEW_ITERATIONS;
    if ((good && iterate(s, h, f)) || (pm_solid_stiffen(s, h) && iterate(s, h, f))) {
        return true;
    }
    const bool predicted = s->npast == PM_SOLID_PAST;
    s->npast = 0;
    return predicted && pm_solid_stiffen(s, h) && iterate(s, h, f);
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
    s->guess = NULL; // it belongs to the whole step
    if (halves == MOST_HALVES) {
        return pm_fail(PM_ENUMERIC, "solid: no balance of forces, not even in steps of %g s", h);
    }
    double *middle = malloc((size_t)n * sizeof *middle);
    if (middle == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a step of a solid");
    }
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
    note_start(s, h);
    return step(s, h, f, 0);
}
