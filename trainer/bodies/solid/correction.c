// Matches nodes by position and loads by place and force, then adds interpolated discrepancies.
#include "bodies/solid/correction.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#define SAME 1e-5       // relative to the size of the body or of a force: single precision
#define SAME_TOTAL 1e-3 // relative to a total force

typedef struct load_place {
    double x[3]; // m
} load_place;

typedef struct correction {
    const pm_field *known;
    int count;
    const int *trajectory; // [count] of known
    pm_field *result;      // the simulated fields, in the numbering of the known ones
    double near;           // m, distance within which two places are the same
    load_place *own;       // [result->ntrajectory] of the simulated loads
    load_place *at;        // [count] of the known loads
    double *difference;    // [count][ntime][nnode][nvariable]
    pm_arena arena;
} correction;

static bool is_near(const double *a, const double *b, double near) {
    return fabs(a[0] - b[0]) <= near && fabs(a[1] - b[1]) <= near && fabs(a[2] - b[2]) <= near;
}

// Finds for every known node the simulated node at the same place, and makes the result: the
// simulated fields in the numbering of the known ones.
static pm_status renumber(correction *c, const pm_field *own) {
    const pm_field *known = c->known;
    const pm_field_shape shape = {own->ntrajectory, own->ntime,      own->nnode,
                                  own->nvariable,   known->nelement, false};
    const size_t row = (size_t)own->nvariable * sizeof *own->z;
    int *node = pm_arena_array(&c->arena, (size_t)own->nnode, sizeof *node);
    PM_TRY(pm_arena_status(&c->arena, "nodes"));
    for (int i = 0; i < own->nnode; ++i) {
        const double *at = known->position + 3 * (ptrdiff_t)i;
        while (node[i] < own->nnode &&
               !is_near(own->position + 3 * (ptrdiff_t)node[i], at, c->near)) {
            ++node[i];
        }
        if (node[i] == own->nnode) {
            return pm_fail(PM_EDATA, "the simulation has no node at (%g, %g, %g) m", at[0], at[1],
                           at[2]);
        }
    }
    PM_TRY(pm_field_new(&c->result, shape, known->dt, known->variable));
    pm_field *d = c->result;
    d->energy = d->clamped = NULL; // not known
    memcpy(d->t, known->t, (size_t)d->ntime * sizeof *d->t);
    memcpy(d->position, known->position, 3 * (size_t)d->nnode * sizeof *d->position);
    if (d->nelement > 0) {
        memcpy(d->hexahedron, known->hexahedron, 8 * (size_t)d->nelement * sizeof *d->hexahedron);
    }
    for (int k = 0; k < d->ntrajectory * d->ntime; ++k) {
        const int i = k / d->ntime, j = k % d->ntime;
        for (int n = 0; n < d->nnode; ++n) {
            memcpy(pm_field_state(d, i, j) + (ptrdiff_t)n * d->nvariable,
                   pm_field_state(own, i, j) + (ptrdiff_t)node[n] * d->nvariable, row);
            memcpy(pm_field_force(d, i, j) + 3 * (ptrdiff_t)n,
                   pm_field_force(own, i, j) + 3 * (ptrdiff_t)node[n], 3 * sizeof *d->f);
        }
    }
    return PM_OK;
}

static pm_status find_place(const pm_field *d, int trajectory, const char *whose, load_place *at) {
    const double *f = pm_field_force(d, trajectory, d->ntime - 1);
    double *x = at->x, sum = 0;
    x[0] = x[1] = x[2] = 0;
    for (int i = 0; i < d->nnode; ++i, f += 3) {
        const double size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
        for (int k = 0; k < 3; ++k) {
            x[k] += size * d->position[3 * i + k];
        }
        sum += size;
    }
    for (int k = 0; k < 3 && sum > 0; ++k) {
        x[k] /= sum;
    }
    return sum > 0
               ? PM_OK
               : pm_fail(
                     PM_EDATA,
                     "trajectory %d of %s has no load at its last time, so the load has no place",
                     trajectory, whose);
}

// Returns the relative difference, over nodes and time, between the forces of a simulated and a
// known trajectory; with `total`, between the sums of their forces over the nodes.
static double force_difference(const correction *c, bool total, int own, int known) {
    const int count = 3 * c->known->nnode;
    double off = 0, whole = 0;
    for (int j = 0; j < c->known->ntime; ++j) {
        const double *a = pm_field_force(c->result, own, j);
        const double *b = pm_field_force(c->known, known, j);
        double sum_a[3] = {0}, sum_b[3] = {0};
        for (int i = 0; i < count && total; ++i) {
            sum_a[i % 3] += a[i];
            sum_b[i % 3] += b[i];
        }
        const double *x = total ? sum_a : a, *y = total ? sum_b : b;
        for (int i = 0; i < (total ? 3 : count); ++i) {
            off += (x[i] - y[i]) * (x[i] - y[i]);
            whole += y[i] * y[i];
        }
    }
    return off == 0 ? 0 : sqrt(off / whole);
}

// Returns the nearest known load of the same size and direction that lies in a row along x with a
// simulated load, in the direction `sign`; -1 if there is none.
static int next_known(const correction *c, int own, double sign) {
    const load_place *p = &c->own[own];
    int best = -1;
    for (int k = 0; k < c->count; ++k) {
        const double *x = c->at[k].x;
        const double ahead = sign * (x[0] - p->x[0]);
        const bool in_row = fabs(x[1] - p->x[1]) <= c->near && fabs(x[2] - p->x[2]) <= c->near;
        if (in_row && ahead >= -c->near &&
            force_difference(c, true, own, c->trajectory[k]) <= SAME_TOTAL &&
            (best < 0 || ahead < sign * (c->at[best].x[0] - p->x[0]))) {
            best = k;
        }
    }
    return best;
}

// Subtracts from each known trajectory the simulated one with the same load, and adds interpolated
// differences to all simulated ones.
static pm_status correct_all(correction *c) {
    const int n = c->result->ntrajectory;
    // The numbers in the fields of one trajectory.
    const size_t count =
        (size_t)c->known->ntime * (size_t)c->known->nnode * (size_t)c->known->nvariable;
    c->own = pm_arena_array(&c->arena, (size_t)n, sizeof *c->own);
    c->at = pm_arena_array(&c->arena, (size_t)c->count, sizeof *c->at);
    c->difference = pm_arena_array(&c->arena, (size_t)c->count * count, sizeof *c->difference);
    PM_TRY(pm_arena_status(&c->arena, "differences of fields"));
    for (int i = 0; i < n; ++i) {
        PM_TRY(find_place(c->result, i, "the simulation", &c->own[i]));
    }
    for (int k = 0; k < c->count; ++k) {
        PM_TRY(find_place(c->known, c->trajectory[k], "the known fields", &c->at[k]));
    }
    for (int k = 0; k < c->count; ++k) {
        const double *x = c->at[k].x;
        const int known = c->trajectory[k];
        int own = 0;
        while (own < n && (!is_near(c->own[own].x, x, c->near) ||
                           force_difference(c, false, own, known) > SAME)) {
            ++own;
        }
        if (own == n) {
            return pm_fail(PM_EDATA,
                           "the simulation has no load like that of trajectory %d of the known "
                           "fields, at (%g, %g, %g) m",
                           known, x[0], x[1], x[2]);
        }
        const double *a = pm_field_state(c->result, own, 0);
        const double *b = pm_field_state(c->known, known, 0);
        for (size_t i = 0; i < count; ++i) {
            c->difference[(size_t)k * count + i] = b[i] - a[i];
        }
    }
    for (int own = 0; own < n; ++own) {
        const double *x = c->own[own].x;
        int low = next_known(c, own, -1), high = next_known(c, own, 1);
        if (low < 0 && high < 0) {
            return pm_fail(PM_EDATA,
                           "no known load of the same size and direction lies in a row with that "
                           "of trajectory %d of the simulation, at (%g, %g, %g) m",
                           own, x[0], x[1], x[2]);
        }
        low = low < 0 ? high : low;
        high = high < 0 ? low : high;
        const double length = c->at[high].x[0] - c->at[low].x[0];
        const double w = length > c->near ? (x[0] - c->at[low].x[0]) / length : 0;
        const double *first = c->difference + (size_t)low * count;
        const double *second = c->difference + (size_t)high * count;
        double *z = pm_field_state(c->result, own, 0);
        for (size_t i = 0; i < count; ++i) {
            z[i] += (1 - w) * first[i] + w * second[i];
        }
    }
    return PM_OK;
}

pm_status pm_correct(pm_field **corrected, const pm_field *own, const pm_field *known, int count,
                     const int *trajectory) {
    correction c = {.known = known, .count = count, .trajectory = trajectory};
    double size = 0;
    pm_status status;
    if (own->nnode != known->nnode || own->ntime != known->ntime ||
        fabs(own->dt - known->dt) > SAME * known->dt) {
        return pm_fail(
            PM_EDATA,
            "the simulation has %d nodes at %d times %g s apart, the known fields have %d "
            "at %d, %g s apart",
            own->nnode, own->ntime, own->dt, known->nnode, known->ntime, known->dt);
    }
    if (strcmp(own->variable, known->variable) != 0) {
        return pm_fail(PM_EDATA, "the simulation has the variables \"%s\", the known fields \"%s\"",
                       own->variable, known->variable);
    }
    for (int i = 0; i < 3 * known->nnode; ++i) {
        size = fmax(size, fabs(known->position[i]));
    }
    c.near = SAME * size;
    PM_TRY_DONE(renumber(&c, own));
    PM_TRY_DONE(correct_all(&c));
    *corrected = c.result;
    c.result = NULL;
done:
    pm_field_free(c.result);
    pm_arena_free(&c.arena);
    return status;
}
