// Short fits of several draws to windows that are not joined. Residuals are divided by a fixed part
// of the deviation of each column, so that the objectives of draws can be compared.
#include "shooting/window_draws.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/progress.h"
#include "optimise/successive_halving.h"

#define NOISE 0.01 // of the deviation of a column
// The fewest windows, and the fewest measurements per weight in all windows.
#define FEWEST_WINDOWS 32
#define MEASUREMENTS_PER_WEIGHT 8
#define STARTS_ITERATIONS 10 // with fixed weights, before the first round
#define ENOUGH 1e-3
// If no draw can be integrated, the windows become half as long and the draws half as far from the
// declared weights, so many times.
#define SHORTEST 2 // samples
#define MOST_CALMER 6
#define CALMER 0.5

typedef struct race {
    pm_shooting *shooting;
    const pm_shooting_search *how;
    double *theta, *z; // [tries][nweight], [tries][nwindow][nz]
    double *damping;   // [tries]
    double distance;   // of the draws from the declared weights, 1: as drawn
    bool hold;         // the weights stay as they are
    int iterations;
} race;

// Runs some more iterations of one draw.
static pm_status advance(void *context, int id, int left, int iterations, double *objective) {
    (void)left;
    race *r = context;
    pm_shooting *s = r->shooting;
    const size_t cells = (size_t)s->nwindow * (size_t)s->nz;
    double *theta = r->theta + (ptrdiff_t)id * s->nweight, *z = r->z + (size_t)id * cells;
    pm_shooting_progress progress = {0};
    const pm_shooting_limits limits = {
        .iterations = iterations, .enough = ENOUGH, .stop = r->how->stop};
    pm_shooting_set_weights(s, theta);
    memcpy(s->z, z, cells * sizeof *z);
    s->terms.hold = r->hold;
    const pm_status status = pm_shooting_minimise(s, &limits, &r->damping[id], &progress);
    s->terms.hold = false;
    *objective = INFINITY; // a draw that cannot be evaluated is dropped
    PM_TRY(status == PM_ENUMERIC ? PM_OK : status);
    if (status == PM_OK) {
        *objective = progress.after;
        pm_shooting_weights(s, theta);
        memcpy(z, s->z, cells * sizeof *z);
        r->iterations += progress.iterations;
    }
    return PM_OK;
}

static pm_status run(race *r, pm_arena *arena) {
    pm_shooting *s = r->shooting;
    const pm_shooting_search *how = r->how;
    const size_t cells = (size_t)s->nwindow * (size_t)s->nz, tries = (size_t)how->tries;
    const double started = pm_clock();
    r->theta = pm_arena_array(arena, tries * (size_t)s->nborder, sizeof *r->theta);
    r->z = pm_arena_array(arena, tries * cells, sizeof *r->z);
    r->damping = pm_arena_array(arena, tries, sizeof *r->damping);
    PM_TRY(pm_arena_status(arena, "initial weights"));
    for (int i = 0; i < how->tries; ++i) {
        double *theta = r->theta + (ptrdiff_t)i * s->nweight;
        how->draw(how->context, i, theta);
        for (int k = 0; k < s->nweight && r->distance < 1; ++k) {
            theta[k] =
                s->terms.first_weight[k] + r->distance * (theta[k] - s->terms.first_weight[k]);
        }
        memcpy(r->z + (size_t)i * cells, s->z, cells * sizeof *r->z);
    }
    int best = 0;
    double objective = INFINITY;
    r->hold = true;
    snprintf(s->label, sizeof s->label, "best of %d starts", how->tries);
    for (int i = 0; i < how->tries; ++i) {
        PM_TRY(advance(r, i, how->tries, STARTS_ITERATIONS, &objective));
        r->damping[i] = 0;
    }
    r->hold = false;
    const pm_successive_halving halving = {how->tries, how->iterations, advance, r};
    PM_TRY(pm_successive_halving_run(&halving, &best, &objective));
    if (!isfinite(objective)) {
        return pm_fail(PM_ENUMERIC, "no initial weights can be integrated; a smaller dt of the "
                                    "scene or more substeps may help");
    }
    pm_shooting_set_weights(s, r->theta + (ptrdiff_t)best * s->nweight);
    printf("start            %8d iterations %8.1f s   objective %.3e   best of %d, number %d\n",
           r->iterations, pm_clock() - started, objective, how->tries, best + 1);
    fflush(stdout);
    return PM_OK;
}

// Draws and chooses with windows of `length` samples.
static pm_status search_windows(race *r, int length) {
    pm_shooting *s = r->shooting;
    const int nz = s->nz;
    pm_shooting_clear(s);
    PM_TRY(pm_shooting_divide(s, length));
    // Drops all but some windows, evenly chosen, and separates them from each other.
    const int wanted = MEASUREMENTS_PER_WEIGHT * s->nweight / (length * s->ny);
    const int count = wanted > FEWEST_WINDOWS ? wanted : FEWEST_WINDOWS, all = s->nwindow;
    s->nwindow = count < all ? count : all;
    for (int i = 0; i < s->nwindow; ++i) {
        const int from = (int)((long)i * all / s->nwindow);
        s->window[i] = s->window[from];
        s->window[i].follows = false;
        s->window[i].ends = true;
        memmove(s->z + (ptrdiff_t)i * nz, s->z + (ptrdiff_t)from * nz, (size_t)nz * sizeof *s->z);
    }
    for (int c = 0; c < s->ny; ++c) {
        s->terms.noise[c] = NOISE * s->tracks->deviation[c];
    }
    pm_arena arena = {0};
    const pm_status status = run(r, &arena);
    pm_arena_free(&arena);
    return status;
}

pm_status pm_shooting_search_start(pm_shooting *s, const pm_shooting_search *search) {
    race r = {.shooting = s, .how = search, .distance = 1};
    pm_shooting_set_substeps(s, (s->how.substeps + 1) / 2); // twice as fast, and near enough
    int length = search->length;
    pm_status status = search_windows(&r, length);
    for (int i = 0; status == PM_ENUMERIC && i < MOST_CALMER; ++i) {
        r.distance *= CALMER;
        length = length > 2 * SHORTEST ? length / 2 : SHORTEST;
        status = search_windows(&r, length);
    }
    pm_shooting_clear(s);
    return status;
}
