// Opens a body, sets and moves its state.
#include "model/solid/solid.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model/solid/solid_parts.h"

// --- opening ---

static pm_status open_memory(pm_solid *s) {
    const size_t nelement = (size_t)s->mesh->nelement, n = 3 * (size_t)s->mesh->nnode;
    pm_arena *a = &s->arena;
    s->ninner = s->mesh->nelement * PM_BRICK_POINTS * s->material->nbranch * PM_SYM;
    s->brick = pm_arena_array(a, nelement, sizeof *s->brick);
    s->start = pm_arena_array(a, nelement, sizeof *s->start);
    s->next = pm_arena_array(a, nelement, sizeof *s->next);
    double *vectors = pm_arena_array(a, (7 + PM_SOLID_PAST) * n, sizeof *vectors);
    double *inner = pm_arena_array(a, 3 * (size_t)s->ninner + 1, sizeof *inner);
    double *pairs = pm_arena_array(a, 2 * PM_SOLID_PAIRS * n, sizeof *pairs);
    s->free = pm_arena_array(a, n, sizeof *s->free);
    s->number = pm_arena_array(a, n, sizeof *s->number);
    if (s->brick == NULL || s->start == NULL || s->next == NULL || vectors == NULL ||
        inner == NULL || pairs == NULL || s->free == NULL || s->number == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a solid");
    }
    s->u = vectors;
    s->trial = vectors + n;
    s->force = vectors + 2 * n;
    s->residual = vectors + 3 * n;
    s->move = vectors + 4 * n;
    s->last = vectors + 5 * n;
    s->stiff_u = vectors + 6 * n;
    s->past = vectors + 7 * n;
    s->inner = inner;
    s->after = inner + s->ninner;
    s->stiff_inner = inner + 2 * (ptrdiff_t)s->ninner;
    s->pair_u = pairs;
    s->pair_f = pairs + PM_SOLID_PAIRS * n;
    return PM_OK;
}

static pm_status open_all(pm_solid *s) {
    PM_TRY(open_memory(s));
    for (int e = 0; e < s->mesh->nelement; ++e) {
        double x[3 * PM_BRICK_NODES];
        pm_solid_gather(s, e, s->mesh->position, x);
        if (!pm_brick_make(&s->brick[e], x)) {
            return pm_fail(PM_ECONFIG, "element %d of a solid is turned inside out", e);
        }
    }
    PM_TRY(pm_solid_number(s));
    pm_solid_set_state(s, NULL, NULL);
    return PM_OK;
}

pm_status pm_solid_open(pm_solid **solid, const pm_solid_mesh *mesh,
                        const pm_solid_material *material) {
    pm_solid *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a solid");
    }
    s->mesh = mesh;
    s->material = material;
    s->precise = PM_SOLID_PRECISE;
    const pm_status status = open_all(s);
    if (status != PM_OK) {
        pm_solid_close(s);
        return status;
    }
    *solid = s;
    return PM_OK;
}

void pm_solid_close(pm_solid *solid) {
    if (solid != NULL) {
        pm_arena_free(&solid->arena);
        free(solid);
    }
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

// Factorises the stiffness again in the state to which it belongs.
static void restore_stiffness(pm_solid *s) {
    double *u = s->u, *inner = s->inner;
    s->u = s->stiff_u;
    s->inner = s->stiff_inner;
    pm_solid_stiffen(s, s->stiff_for);
    s->u = u;
    s->inner = inner;
}

void pm_solid_record(pm_solid *s, pm_record *record) {
    double step = isnan(s->stiff_for) ? 0 : s->stiff_for;
    pm_record_put(record, "step of the stiffness", &step, 1);
    pm_record_put_int(record, "iterations", &s->books.iterations);
    pm_record_put_int(record, "past displacements", &s->npast);
    pm_record_put(record, "step between them", &s->past_for, 1);
    pm_record_put(record, "past", s->past, PM_SOLID_PAST * 3 * s->mesh->nnode);
    pm_record_put_int(record, "pairs", &s->npair);
    pm_record_put(record, "moves of the pairs", s->pair_u, PM_SOLID_PAIRS * s->nfree);
    pm_record_put(record, "forces of the pairs", s->pair_f, PM_SOLID_PAIRS * s->nfree);
    pm_record_put(record, "u of the stiffness", s->stiff_u, 3 * s->mesh->nnode);
    pm_record_put(record, "inner of the stiffness", s->stiff_inner, s->ninner);
    if (pm_record_restores(record)) {
        s->stiff_for = step == 0 ? NAN : step;
        if (step != 0) {
            const int npair = s->npair;
            restore_stiffness(s);
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
