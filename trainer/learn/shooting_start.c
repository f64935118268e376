// Short fits of several draws to windows that are not joined. Residuals are divided by a fixed part
// of the deviation of each column, so that the objectives of draws can be compared.
#include "learn/shooting_start.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/progress.h"

#define NOISE 0.01 // of the deviation of a column
// The fewest windows, and the fewest measurements per weight in all windows.
#define FEWEST_WINDOWS 32
#define MEASUREMENTS_PER_WEIGHT 8
#define STARTS_ITERATIONS 10 // with fixed weights, before the first round
#define ENOUGH 1e-3

typedef struct contender {
    int id;
    double *theta, *z; // [nweight], [nwindow][nz]
    double damping, objective;
} contender;

typedef struct race {
    pm_shooting *shooting;
    const pm_shooting_search *how;
    contender *contender; // the first `count` are still in the race
    int count, iterations;
} race;

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for initial weights");
}

// Drops all but `count` windows, evenly chosen, and separates them from each other.
static void choose_windows(pm_shooting *s, int count) {
    const int all = s->nwindow, nz = s->nz;
    const int kept = count < all ? count : all;
    for (int i = 0; i < kept; ++i) {
        const int from = (int)((long)i * all / kept);
        s->window[i] = s->window[from];
        s->window[i].follows = false;
        s->window[i].ends = true;
        memmove(s->z + (ptrdiff_t)i * nz, s->z + (ptrdiff_t)from * nz, (size_t)nz * sizeof *s->z);
    }
    s->nwindow = kept;
}

// Runs some more iterations of one draw.
static pm_status advance(race *r, contender *a, int iterations, bool hold) {
    pm_shooting *s = r->shooting;
    const size_t cells = (size_t)s->nwindow * (size_t)s->nz;
    pm_shooting_progress progress = {0};
    const pm_shooting_limits limits = {
        .iterations = iterations, .enough = ENOUGH, .stop = r->how->stop};
    pm_shooting_set_weights(s, a->theta);
    memcpy(s->z, a->z, cells * sizeof *s->z);
    s->hold = hold;
    const pm_status status = pm_shooting_minimise(s, &limits, &a->damping, &progress);
    s->hold = false;
    a->objective = INFINITY; // a draw that cannot be evaluated is dropped
    PM_TRY(status == PM_ENUMERIC ? PM_OK : status);
    if (status == PM_OK) {
        a->objective = progress.after;
        pm_shooting_weights(s, a->theta);
        memcpy(a->z, s->z, cells * sizeof *s->z);
        r->iterations += progress.iterations;
    }
    return PM_OK;
}

// Compares draws by objective, then by number, so that the order is unique.
static int compare(const void *a, const void *b) {
    const contender *x = a, *y = b;
    return x->objective != y->objective ? (x->objective < y->objective ? -1 : 1) : x->id - y->id;
}

static pm_status halve(race *r) {
    int iterations = r->how->iterations;
    for (int i = 0; i < r->count; ++i) {
        PM_TRY(advance(r, &r->contender[i], STARTS_ITERATIONS, true));
        r->contender[i].damping = 0;
    }
    while (r->count > 1) {
        for (int i = 0; i < r->count; ++i) {
            PM_TRY(advance(r, &r->contender[i], iterations, false));
        }
        qsort(r->contender, (size_t)r->count, sizeof *r->contender, compare);
        r->count = (r->count + 1) / 2;
        iterations += iterations / 2;
    }
    return isfinite(r->contender[0].objective)
               ? PM_OK
               : pm_fail(PM_ENUMERIC, "no initial weights can be integrated; a smaller dt of the "
                                      "scene or more substeps may help");
}

static pm_status draw_all(race *r) {
    const pm_shooting *s = r->shooting;
    const size_t cells = (size_t)s->nwindow * (size_t)s->nz;
    for (int i = 0; i < r->count; ++i) {
        contender *a = &r->contender[i];
        a->id = i;
        a->theta = malloc(((size_t)s->nweight + 1) * sizeof *a->theta);
        a->z = malloc(cells * sizeof *a->z);
        if (a->theta == NULL || a->z == NULL) {
            return no_memory();
        }
        r->how->draw(r->how->context, i, a->theta);
        memcpy(a->z, s->z, cells * sizeof *a->z);
    }
    return PM_OK;
}

static pm_status run(race *r) {
    const double started = pm_clock();
    const int tries = r->count;
    PM_TRY(draw_all(r));
    PM_TRY(halve(r));
    pm_shooting_set_weights(r->shooting, r->contender[0].theta);
    printf("start            %8d iterations %8.1f s   objective %.3e   best of %d, number %d\n",
           r->iterations, pm_clock() - started, r->contender[0].objective, tries,
           r->contender[0].id + 1);
    fflush(stdout);
    return PM_OK;
}

pm_status pm_shooting_search_start(pm_shooting *s, const pm_shooting_search *search) {
    race r = {.shooting = s, .how = search, .count = search->tries};
    pm_shooting_set_substeps(s, (s->how.substeps + 1) / 2); // twice as fast, and near enough
    PM_TRY(pm_shooting_divide(s, search->length));
    const int wanted = MEASUREMENTS_PER_WEIGHT * s->nweight / (search->length * s->ny);
    choose_windows(s, wanted > FEWEST_WINDOWS ? wanted : FEWEST_WINDOWS);
    for (int c = 0; c < s->ny; ++c) {
        s->noise[c] = NOISE * s->tracks->deviation[c];
    }
    r.contender = calloc((size_t)search->tries, sizeof *r.contender);
    const pm_status status = r.contender == NULL ? no_memory() : run(&r);
    for (int i = 0; i < search->tries && r.contender != NULL; ++i) {
        free(r.contender[i].theta);
        free(r.contender[i].z);
    }
    free(r.contender);
    pm_shooting_clear(s);
    return status;
}
