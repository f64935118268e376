// Multiple shooting with fixed weights on the first samples, and a prediction by the same steps.
#include "inference/estimate.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "shooting/continuation.h"

// The standard deviation of a normal distribution over its median and its mean distance from the
// middle.
#define NORMAL_MEDIAN 1.4826022185056018
#define NORMAL_MEAN 1.2533141373155001
#define WHOLE (INT_MAX / 4) // samples of a window: each track is one
#define FOLLOWED 1.5        // mean square of what is left, over that of the noise
#define OUTLYING 0.01       // of the misses of a trajectory, beside those that stand alone
// Keeps the equations of a start regular where nothing depends on a component.
#define LEAST_CURVATURE 1e-12
// A record has a noise of its own if the logarithm of its noise differs from that of the fit by
// more than this many standard errors.
#define OTHER 2.0
#define LEAST_NOISE 1e-3 // of that of the fit
#define NARROWEST 0.1    // of the deviation that a scene gives to a start: no prior is narrower

static pm_sensitivity_how how_of(pm_system *system, const pm_observation *o,
                                 const pm_tracks *tracks, bool fixed) {
    const pm_scene *scene = system->scene;
    return (pm_sensitivity_how){.system = system,
                                .observation = o,
                                .integrator = scene->physics.integrator,
                                .substeps = scene->physics.substeps,
                                .stretched = tracks->stretched,
                                .fixed = fixed};
}

// --- starts ---

// The part of the uncertainty of predictions that comes from the estimated starts.
typedef struct start_uncertainty {
    double *by_weights; // [count][nz][nweight] derivative of the estimated start by the weights
    double *covariance; // [count][nz][nz] of the start at fixed weights
    double *noise;      // [ny] of the columns, from sample to sample
} start_uncertainty;

// Finds the noise of each column from sample to sample: that of the fit, or that of the residuals
// in the first seconds, which s holds, if it clearly is another one: records may come from a better
// or a worse sensor, or from a simulator.
static pm_status find_noise(const pm_estimate *e, const pm_shooting *s, const pm_uncertainty *u,
                            start_uncertainty *start) {
    size_t all = 1;
    for (int i = 0; i < s->tracks->count; ++i) {
        all += (size_t)s->tracks->track[i].count;
    }
    double *size = malloc(all * sizeof *size);
    PM_TRY(size != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for an estimate"));
    for (int c = 0; c < s->ny; ++c) {
        double error; // standard error of the logarithm
        const double known = u->independent[c];
        const double own =
            fmax(pm_uncertainty_independent(s, c, size, &error), LEAST_NOISE * known);
        start->noise[c] = fabs(log(own / known)) > OTHER * error ? own : known;
        // What neighbouring residuals share is error of the model.
        const double shared = fmax(u->noise[c] * u->noise[c] - known * known, 0);
        e->noise[c] = sqrt(shared + start->noise[c] * start->noise[c]);
    }
    free(size);
    return PM_OK;
}

// The prior of a hidden component of the start is what the scene says, or narrower, as the starts
// of the trajectories of the fit spread.
static void set_priors(pm_shooting *s, const pm_observation *o, const pm_uncertainty *u) {
    for (int c = 0; c < s->nz; ++c) {
        const double given = o->hidden[c] ? o->deviation[c] : 0;
        const double spread = u == NULL ? given : fmax(u->spread[c], NARROWEST * given);
        s->terms.prior[c] = fmin(given, spread);
    }
}

// Evaluates the normal equations of the starts and the weights at the estimate, with each track as
// one window. They give the derivative of an estimated start by the weights, -own^-1 border.
static pm_status differentiate(const pm_estimate *e, pm_shooting *s,
                               const start_uncertainty *start) {
    const ptrdiff_t nz = e->nz, nb = s->nborder, n = s->nweight;
    PM_TRY(pm_shooting_divide(s, WHOLE));
    // What neighbouring residuals share is error of the model, which counts by the weights.
    memcpy(s->terms.noise, start->noise, (size_t)e->ny * sizeof *s->terms.noise);
    s->terms.huber = INFINITY;
    memcpy(s->z, e->start, (size_t)(e->count * nz) * sizeof *s->z);
    pm_shooting_evaluate(s, s->z, true);
    PM_TRY(s->failed);
    for (ptrdiff_t i = 0; i < e->count; ++i) {
        double *own = s->blocks.own + i * nz * nz, *border = s->blocks.border + i * nz * nb;
        double *covariance = start->covariance + i * nz * nz;
        for (ptrdiff_t k = 0; k < nz; ++k) {
            own[k * (nz + 1)] += LEAST_CURVATURE;
            covariance[k * (nz + 1)] = 1;
        }
        if (!pm_cholesky_factor((int)nz, own)) {
            // Where the start cannot be followed through the first samples, it is as uncertain as
            // a sample and the guess.
            for (ptrdiff_t k = 0; k < nz; ++k) {
                const double prior = s->terms.prior[k];
                covariance[k * (nz + 1)] = prior * prior;
            }
            for (ptrdiff_t c = 0; c < e->ny; ++c) {
                const ptrdiff_t k = s->observation->component[c];
                if (k >= 0) {
                    covariance[k * (nz + 1)] = start->noise[c] * start->noise[c];
                }
            }
            continue;
        }
        pm_cholesky_back((int)nz, own, (int)nb, border);
        pm_cholesky_back((int)nz, own, (int)nz, covariance);
        for (ptrdiff_t k = 0; k < nz * n; ++k) {
            start->by_weights[i * nz * n + k] = -border[k / n * nb + k % n];
        }
    }
    return PM_OK;
}

static pm_status find_uncertainty(pm_estimate *e, pm_system *system, const pm_observation *o,
                                  const pm_tracks *tracks, const pm_shooting *estimated,
                                  const pm_uncertainty *u, start_uncertainty *start) {
    const size_t cells = (size_t)e->count * (size_t)e->nz;
    start->by_weights =
        pm_arena_array(&e->arena, cells * (size_t)u->nweight + 1, sizeof *start->by_weights);
    start->covariance = pm_arena_array(&e->arena, cells * (size_t)e->nz, sizeof *start->covariance);
    start->noise = pm_arena_array(&e->arena, (size_t)e->ny, sizeof *start->noise);
    PM_TRY(pm_arena_status(&e->arena, "an estimate"));
    PM_TRY(find_noise(e, estimated, u, start));
    pm_shooting shooting = {0};
    const pm_sensitivity_how how = how_of(system, o, tracks, false);
    pm_status status = pm_shooting_open(&shooting, &how, tracks);
    if (status == PM_OK) {
        set_priors(&shooting, o, u);
        status = differentiate(e, &shooting, start);
    }
    pm_shooting_close(&shooting);
    return status;
}

// Seeks the starts in whole tracks from the guess at once and, unless that follows all of them, in
// short windows that grow: each may end where the other does not, as dry friction makes many
// minima. Of each track it takes what leaves less, and writes that, in squares of the noise for a
// measurement, to least [count].
static pm_status seek_starts(pm_estimate *e, pm_shooting *s, const pm_continuation *continuation,
                             double *least) {
    const int first[] = {pm_continuation_longest(s), 0}, substeps = s->how.substeps;
    pm_status result = PM_ENUMERIC;
    bool followed = false;
    const double most = continuation->work > 0 ? continuation->work : INFINITY;
    for (int way = 0; way < 2 && !followed && (way == 0 || s->work < most); ++way) {
        pm_continuation own = *continuation;
        own.first = first[way];
        pm_shooting_set_substeps(s, substeps); // those of a continuation that failed may be fewer
        pm_shooting_clear(s);
        const pm_status status = pm_continuation_run(s, &own, NULL);
        if (status == PM_ENUMERIC) {
            continue;
        }
        PM_TRY(status);
        PM_TRY(pm_shooting_divide(s, WHOLE));
        pm_shooting_evaluate(s, s->z, false);
        PM_TRY(s->failed);
        if (result != PM_OK) {
            memcpy(e->noise, s->terms.noise, (size_t)e->ny * sizeof *e->noise);
        }
        followed = true;
        for (int i = 0; i < e->count; ++i) {
            const pm_track *track = &s->tracks->track[i];
            const double *start = s->z + (ptrdiff_t)i * e->nz;
            double left = 0; // of the measurements and of the prior
            long measured = 0;
            for (ptrdiff_t k = 0; k < (ptrdiff_t)track->count * e->ny; ++k) {
                const double r = s->residual[i][k] / e->noise[k % e->ny];
                left += isfinite(track->y[k]) ? r * r : 0;
                measured += isfinite(track->y[k]);
            }
            followed = followed && left < FOLLOWED * (double)measured;
            for (int c = 0; c < e->nz; ++c) {
                const double prior = s->terms.prior[c], away = start[c] - s->observation->guess[c];
                left += prior > 0 ? away * away / (prior * prior) : 0;
            }
            left = isfinite(left) ? left / fmax((double)measured, 1) : INFINITY;
            if (result != PM_OK || left < least[i]) {
                least[i] = left;
                memcpy(e->start + (ptrdiff_t)i * e->nz, start, (size_t)e->nz * sizeof *start);
            }
        }
        result = PM_OK;
    }
    return result;
}

// Seeks the starts of trajectories that have not been followed, one after the other, so that those
// that cannot be followed spoil no others. least [count] is what earlier starts leave; where all of
// it is infinite, there are none: of what cannot be followed it takes the measurements and the
// guess. PM_ENUMERIC: it is none.
static pm_status seek_singly(pm_estimate *e, pm_shooting *s, const pm_sensitivity_how *how,
                             const pm_continuation *continuation, double *least) {
    const double most = continuation->work > 0 ? continuation->work : INFINITY;
    const size_t nz = (size_t)e->nz;
    double *noise = pm_arena_array(&e->arena, (size_t)e->ny, sizeof *noise);
    double *found = pm_arena_array(&e->arena, nz, sizeof *found);
    PM_TRY(pm_arena_status(&e->arena, "an estimate"));
    bool none = true, any = false;
    for (int i = 0; i < e->count; ++i) {
        none = none && !isfinite(least[i]);
    }
    for (int i = 0; i < e->count && s->work < most; ++i) {
        double *start = e->start + (size_t)i * nz;
        double left = INFINITY;
        pm_estimate own = {.count = 1, .ny = e->ny, .nz = e->nz, .start = found, .noise = noise};
        pm_tracks track = *s->tracks;
        pm_shooting one = {0};
        if (least[i] < FOLLOWED) {
            continue;
        }
        track.count = 1;
        track.track += i;
        pm_status status = pm_shooting_open(&one, how, &track);
        if (status == PM_OK) {
            memcpy(one.terms.prior, s->terms.prior, nz * sizeof *one.terms.prior);
            snprintf(one.label, sizeof one.label, "start %d of %d", i + 1, e->count);
            status = seek_starts(&own, &one, continuation, &left);
        }
        s->work += one.work;
        pm_shooting_close(&one);
        pm_arena_free(&own.arena);
        PM_TRY(status == PM_ENUMERIC ? PM_OK : status);
        if (status == PM_OK && left < least[i]) {
            memcpy(start, found, nz * sizeof *start);
            if (none && !any) {
                memcpy(e->noise, noise, (size_t)e->ny * sizeof *noise);
            }
            any = true;
        } else if (none) {
            pm_track_sample_states(s->tracks, i, how->system->scene, s->observation, 0, 1, start);
        }
    }
    return any || !none ? PM_OK : PM_ENUMERIC;
}

static pm_status find_starts(pm_estimate *e, pm_system *system, const pm_observation *o,
                             const pm_dataset *dataset, const int *which,
                             const pm_estimate_how *how, start_uncertainty *start) {
    pm_tracks tracks;
    pm_shooting shooting = {0};
    double *given = pm_arena_array(&e->arena, (size_t)e->ny, sizeof *given);
    double *least = pm_arena_array(&e->arena, (size_t)e->count, sizeof *least);
    PM_TRY(pm_arena_status(&e->arena, "an estimate"));
    pm_observation known = *o;
    if (how->uncertainty != NULL) {
        // The mean start of the trajectories of the fit is the best guess about hidden components.
        memcpy(given, how->uncertainty->noise, (size_t)e->ny * sizeof *given);
        known.guess = how->uncertainty->start;
    }
    PM_TRY(pm_tracks_make(&tracks, system->scene, &known, dataset, e->count, which, how->seconds,
                          true));
    const pm_sensitivity_how own = how_of(system, &known, &tracks, true);
    pm_status status;
    PM_TRY_DONE(pm_shooting_open(&shooting, &own, &tracks));
    set_priors(&shooting, o, how->uncertainty);
    snprintf(shooting.label, sizeof shooting.label, "starts");
    const pm_continuation continuation = {.given = given,
                                          .typical = o->deviation,
                                          .stop = how->stop,
                                          .work = how->work,
                                          .brief = true};
    for (int i = 0; i < e->count; ++i) {
        least[i] = INFINITY;
    }
    status = seek_starts(e, &shooting, &continuation, least);
    if (e->count > 1 && (status == PM_OK || status == PM_ENUMERIC)) {
        status = seek_singly(e, &shooting, &own, &continuation, least);
    }
    PM_TRY_DONE(status);
    shooting.stride = 1; // a continuation that failed may have been about some tracks alone
    PM_TRY_DONE(pm_shooting_divide(&shooting, WHOLE)); // each track is one window
    memcpy(shooting.z, e->start, (size_t)e->count * (size_t)e->nz * sizeof *e->start);
    pm_shooting_evaluate(&shooting, shooting.z, false);
    PM_TRY_DONE(shooting.failed);
    e->work = shooting.work;
    if (how->uncertainty != NULL) {
        status = find_uncertainty(e, system, o, &tracks, &shooting, how->uncertainty, start);
    }
done:
    pm_shooting_close(&shooting);
    pm_tracks_free(&tracks);
    return status;
}

// --- prediction ---

// A prediction in progress, with work space.
typedef struct prediction_work {
    pm_sensitivity *sensitivity;
    const pm_uncertainty *uncertainty; // NULL: no derivatives
    const start_uncertainty *start;
    pm_sensitivity_item item[PM_SENSITIVITY_BATCH];
    double *y, *by_start, *by_weights; // [PM_SENSITIVITY_BATCH] of [ny], [ny][nz], [ny][nweight]
    double *product;                   // [ny or nz, the larger][nweight]
    int ninput;                        // nprescribed of the scene
} prediction_work;

// Returns row covariance row' for a symmetric covariance [n][n].
static double quadratic_form(int n, const double *row, const double *covariance) {
    double sum = 0;
    for (ptrdiff_t i = 0; i < n; ++i) {
        double product = 0;
        for (ptrdiff_t k = 0; k < n; ++k) {
            product += covariance[i * n + k] * row[k];
        }
        sum += row[i] * product;
    }
    return sum;
}

// Writes the variances [count] that the weights cause in values with the derivatives by_weights
// [count][nweight].
static void weight_variances(const prediction_work *p, int count, const double *by_weights,
                             double *variance) {
    const ptrdiff_t n = p->uncertainty->nweight;
    if (n > 0) {
        pm_gemm(false, false, count, (int)n, (int)n, by_weights, p->uncertainty->covariance,
                p->product);
    }
    for (ptrdiff_t i = 0; i < count; ++i) {
        variance[i] = 0;
        for (ptrdiff_t k = 0; k < n; ++k) {
            variance[i] += by_weights[i * n + k] * p->product[i * n + k];
        }
    }
}

// Follows `count` tracks from their starts together, one sample after the other. The first of them
// has the number `first` in the estimate.
static void follow(pm_estimate *e, prediction_work *p, const pm_track *track, int first,
                   int count) {
    int longest = 0;
    // Puts the items of a batch at the starts of the tracks from `first` on.
    const size_t nz = (size_t)e->nz;
    for (int i = 0; i < count; ++i) {
        memcpy(p->item[i].z, e->start + (size_t)(first + i) * nz, nz * sizeof *e->start);
        if (p->uncertainty != NULL) {
            const size_t cells = nz * (size_t)p->uncertainty->nweight;
            pm_sensitivity_start(p->sensitivity, &p->item[i]);
            memcpy(p->item[i].by_weights, p->start->by_weights + (size_t)(first + i) * cells,
                   cells * sizeof *p->item[i].by_weights);
        }
    }
    for (int i = 0; i < count; ++i) {
        longest = track[i].count > longest ? track[i].count : longest;
    }
    for (int k = 0; k < longest; ++k) {
        pm_sensitivity_item *item[PM_SENSITIVITY_BATCH];
        const pm_track *moving[PM_SENSITIVITY_BATCH];
        int which[PM_SENSITIVITY_BATCH], sample[PM_SENSITIVITY_BATCH], n = 0;
        for (int i = 0; i < count; ++i) {
            moving[i] = &track[i];
            sample[i] = k < track[i].count ? k : -1;
            if (k < track[i].count) {
                const double *now = track[i].now;
                p->item[i].now = now == NULL ? NULL : now + (ptrdiff_t)k * p->ninput;
                which[n] = i;
                item[n++] = &p->item[i];
            }
        }
        pm_sensitivity_measure(p->sensitivity, n, item, p->y, p->by_start, p->by_weights);
        for (int i = 0; i < n; ++i) {
            const ptrdiff_t id = first + which[i], rows = e->ny, states = e->nz;
            const ptrdiff_t at = id * e->ntime + track[which[i]].sample[k];
            const pm_uncertainty *u = p->uncertainty;
            memcpy(e->z + at * states, item[i]->z, nz * sizeof *e->z);
            memcpy(e->y + at * rows, p->y + i * rows, (size_t)rows * sizeof *e->y);
            if (u == NULL) {
                continue;
            }
            const double *start = p->start->covariance + id * states * states;
            double *weights = e->by_weights + at * rows, *state = e->state_deviation + at * states;
            weight_variances(p, e->ny, p->by_weights + i * rows * u->nweight, weights);
            for (ptrdiff_t c = 0; c < rows; ++c) {
                const double own =
                    quadratic_form(e->nz, p->by_start + (i * rows + c) * states, start);
                e->deviation[at * rows + c] =
                    sqrt(e->noise[c] * e->noise[c] + own + u->scale * weights[c]);
            }
            weight_variances(p, e->nz, item[i]->by_weights, state);
            for (ptrdiff_t c = 0; c < states; ++c) {
                state[c] = sqrt(quadratic_form(e->nz, item[i]->by_start + c * states, start) +
                                u->scale * state[c]);
            }
        }
        pm_sensitivity_advance(p->sensitivity, count, p->item, moving, sample);
    }
}

// Predicts all samples, with `finer` times as many steps as the scene has.
static pm_status predict(pm_estimate *e, pm_system *system, const pm_observation *o,
                         const pm_dataset *dataset, const int *which, const pm_estimate_how *how,
                         const start_uncertainty *start, int finer) {
    pm_tracks tracks;
    prediction_work p = {.uncertainty = how->uncertainty,
                         .start = start,
                         .ninput = system->scene->physics.nprescribed};
    const size_t nz = (size_t)e->nz, ny = (size_t)e->ny, batch = PM_SENSITIVITY_BATCH;
    const size_t n = p.uncertainty == NULL ? 0 : (size_t)p.uncertainty->nweight;
    p.y = pm_arena_array(&e->arena, batch * ny, sizeof *p.y);
    p.by_start = pm_arena_array(&e->arena, batch * ny * nz, sizeof *p.by_start);
    p.by_weights = pm_arena_array(&e->arena, batch * ny * n + 1, sizeof *p.by_weights);
    p.product = pm_arena_array(&e->arena, (ny > nz ? ny : nz) * n + 1, sizeof *p.product);
    pm_sensitivity_allocate(PM_SENSITIVITY_BATCH, p.item, nz, n, &e->arena);
    PM_TRY(pm_arena_status(&e->arena, "an estimate"));
    PM_TRY(pm_tracks_make(&tracks, system->scene, o, dataset, e->count, which, INFINITY, false));
    pm_sensitivity_how own = how_of(system, o, &tracks, false);
    own.substeps *= finer;
    pm_sensitivity_work work;
    pm_status status = pm_sensitivity_open(&p.sensitivity, &own, how->uncertainty != NULL, &work);
    for (int i = 0; i < e->count && status == PM_OK; i += PM_SENSITIVITY_BATCH) {
        const int left = e->count - i;
        follow(e, &p, &tracks.track[i], i,
               left < PM_SENSITIVITY_BATCH ? left : PM_SENSITIVITY_BATCH);
        status = how->stop != NULL && *how->stop ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK;
    }
    pm_sensitivity_close(p.sensitivity);
    pm_tracks_free(&tracks);
    return status;
}

// Returns an array of NaN; NULL: out of memory.
static double *array_of_nan(pm_arena *arena, size_t n) {
    double *array = pm_arena_array(arena, n, sizeof *array);
    for (size_t i = 0; i < n && array != NULL; ++i) {
        array[i] = NAN;
    }
    return array;
}

// Predicts once more with half of the steps.
static pm_status find_coarseness(pm_estimate *e, pm_system *system, const pm_observation *o,
                                 const pm_dataset *dataset, const int *which,
                                 const pm_estimate_how *how) {
    const pm_estimate_how states = {.stop = how->stop};
    pm_estimate fine = *e;
    const size_t samples = (size_t)e->count * (size_t)e->ntime;
    fine.y = array_of_nan(&e->arena, samples * (size_t)e->ny);
    fine.z = array_of_nan(&e->arena, samples * (size_t)e->nz);
    PM_TRY(pm_arena_status(&e->arena, "an estimate"));
    fine.arena = (pm_arena){0};
    const pm_status status = predict(&fine, system, o, dataset, which, &states, NULL, 2);
    pm_arena_free(&fine.arena);
    PM_TRY(status);
    e->coarse = 0;
    for (size_t c = 0; c < (size_t)e->ny; ++c) {
        double sum = 0, square = 0, away = 0, n = 0;
        for (size_t i = c; i < samples * (size_t)e->ny; i += (size_t)e->ny) {
            const bool finite = isfinite(e->y[i]) && isfinite(fine.y[i]);
            const double y = finite ? fine.y[i] : 0, d = finite ? e->y[i] - y : 0;
            sum += y;
            square += y * y;
            away += d * d;
            n += finite;
            // If predictions are finite with half of the steps alone, the steps cost everything.
            e->coarse = isfinite(fine.y[i]) && !isfinite(e->y[i]) ? INFINITY : e->coarse;
        }
        const double variance = n > 0 ? square / n - sum / n * (sum / n) : 0;
        e->coarse = variance > 0 ? fmax(e->coarse, sqrt(away / n / variance)) : e->coarse;
    }
    return PM_OK;
}

pm_status pm_estimate_make(pm_estimate *e, pm_system *system, const pm_observation *o,
                           const pm_dataset *dataset, int count, const int *which,
                           const pm_estimate_how *how) {
    start_uncertainty start = {0};
    *e = (pm_estimate){.count = count,
                       .ntime = dataset->ntime,
                       .ny = o->count,
                       .nz = system->scene->physics.nz,
                       .until = how->until > 0 ? how->until : INFINITY};
    const size_t samples = (size_t)e->count * (size_t)e->ntime;
    const size_t ny = (size_t)e->ny, nz = (size_t)e->nz;
    e->start = pm_arena_array(&e->arena, (size_t)e->count * nz, sizeof *e->start);
    e->noise = pm_arena_array(&e->arena, ny, sizeof *e->noise);
    e->y = array_of_nan(&e->arena, samples * ny);
    e->z = array_of_nan(&e->arena, samples * nz);
    if ((how->uncertainty != NULL)) {
        e->deviation = array_of_nan(&e->arena, samples * ny);
        e->by_weights = array_of_nan(&e->arena, samples * ny);
        e->state_deviation = array_of_nan(&e->arena, samples * nz);
    }
    pm_status status = pm_arena_status(&e->arena, "an estimate");
    if (status == PM_OK) {
        status = find_starts(e, system, o, dataset, which, how, &start);
    }
    if (status == PM_OK) {
        status = predict(e, system, o, dataset, which, how, &start, 1);
    }
    if (status == PM_OK && how->halve) {
        status = find_coarseness(e, system, o, dataset, which, how);
    }
    if (status != PM_OK) {
        pm_estimate_free(e);
    }
    return status;
}

void pm_estimate_free(pm_estimate *e) {
    pm_arena_free(&e->arena);
    *e = (pm_estimate){0};
}

// --- scores ---

// The measurement of sample k of an estimate, or NAN if there is none that counts after the first
// seconds.
static double later_sample(const pm_estimate *e, const pm_observation *o, const pm_dataset *d,
                           int trajectory, double seconds, int k, int column) {
    const double t = pm_dataset_time(d, trajectory, k) - pm_dataset_time(d, trajectory, 0);
    return t > seconds && t <= e->until ? pm_dataset_state(d, trajectory, k)[o->column[column]]
                                        : NAN;
}

// Writes the squared errors of one column of one trajectory after the first `seconds` to miss
// [ntime], and returns their number. *variance receives the variance of all measurements of the
// column.
static int misses_of(const pm_estimate *e, const pm_observation *o, const pm_dataset *dataset,
                     const int *which, double seconds, int id, int column, double *miss,
                     double *variance) {
    double mean = 0, square = 0;
    int n = 0, later = 0;
    for (int k = 0; k < e->ntime; ++k) {
        const double y = later_sample(e, o, dataset, which[id], -1, k, column);
        mean += isnan(y) ? 0 : y;
        n += !isnan(y);
    }
    mean /= n > 0 ? n : 1;
    for (int k = 0; k < e->ntime; ++k) {
        const double any = later_sample(e, o, dataset, which[id], -1, k, column);
        const double y = later_sample(e, o, dataset, which[id], seconds, k, column);
        const double r = e->y[((ptrdiff_t)id * e->ntime + k) * e->ny + column] - y;
        square += isnan(any) ? 0 : (any - mean) * (any - mean) / n;
        if (!isnan(y)) {
            miss[later++] = r * r;
        }
    }
    *variance = square;
    return later;
}

// Returns the root mean square error of one trajectory beyond the noise, divided by its standard
// deviation. With `part` > 0 it leaves out outliers: each error is limited to the larger of its two
// neighbours, and the fraction `part` of the largest errors does not count.
static double left_of(const pm_estimate *e, const pm_observation *o, const pm_dataset *dataset,
                      const int *which, double seconds, int id, int column, double part,
                      double noise, double *miss) {
    double variance = 0, sum = 0, before = 0;
    const int later = misses_of(e, o, dataset, which, seconds, id, column, miss, &variance);
    const int kept = later - (int)(part * later);
    for (int k = 0; k < later && part > 0; ++k) { // what a model misses lasts
        const double now = miss[k], next = k + 1 < later ? miss[k + 1] : 0;
        miss[k] = fmin(now, fmax(before, next));
        before = now;
    }
    if (part > 0) {
        pm_sort((size_t)later, miss);
    }
    for (int k = 0; k < kept; ++k) {
        sum += miss[k];
    }
    return later == 0      ? NAN
           : isfinite(sum) ? sqrt(fmax(sum / kept - noise * noise, 0) / variance)
                           : INFINITY;
}

double pm_estimate_error(const pm_estimate *e, const pm_observation *o, const pm_dataset *dataset,
                         const int *which, double seconds, int id, int column) {
    double *miss = malloc((size_t)e->ntime * sizeof *miss);
    const double error =
        miss == NULL ? NAN : left_of(e, o, dataset, which, seconds, id, column, 0, 0, miss);
    free(miss);
    return error;
}

double pm_estimate_unexplained(const pm_estimate *e, const pm_observation *o,
                               const pm_dataset *dataset, const int *which, double seconds,
                               int column, double noise) {
    double *error = malloc((size_t)(e->count + e->ntime) * sizeof *error), *miss = error + e->count;
    double median = NAN;
    for (int i = 0; i < e->count && error != NULL; ++i) {
        error[i] = left_of(e, o, dataset, which, seconds, i, column, OUTLYING, noise, miss);
    }
    if (error != NULL) {
        median = pm_box_of(e->count, error).median;
    }
    free(error);
    return median;
}

pm_box pm_estimate_errors(const pm_estimate *e, const pm_observation *o, const pm_dataset *dataset,
                          const int *which, double seconds, int column) {
    double *error = malloc((size_t)e->count * sizeof *error);
    if (error == NULL) {
        return (pm_box){.median = NAN, .mean = NAN, .largest = NAN};
    }
    for (int i = 0; i < e->count; ++i) {
        error[i] = pm_estimate_error(e, o, dataset, which, seconds, i, column);
    }
    const pm_box box = pm_box_of(e->count, error);
    free(error);
    return box;
}

double pm_estimate_typical_error(const pm_estimate *e, const pm_observation *o,
                                 const pm_dataset *dataset, const int *which, double seconds,
                                 int column) {
    const size_t most = (size_t)e->count * (size_t)e->ntime;
    double *y = malloc(2 * most * sizeof *y), *miss = y == NULL ? NULL : y + most;
    double error = NAN, distance = 0;
    int n = 0, later = 0;
    for (int i = 0; y != NULL && i < e->count; ++i) {
        for (int k = 0; k < e->ntime; ++k) {
            const double value = later_sample(e, o, dataset, which[i], -1, k, column);
            const double predicted = e->y[((ptrdiff_t)i * e->ntime + k) * e->ny + column];
            if (!isnan(value)) {
                y[n++] = value;
            }
            if (!isnan(later_sample(e, o, dataset, which[i], seconds, k, column))) {
                miss[later++] = fabs(predicted - value);
            }
        }
    }
    if (later > 0) {
        const double middle = pm_box_of(n, y).median;
        for (int k = 0; k < n; ++k) {
            distance += fabs(y[k] - middle) / n;
        }
        error = NORMAL_MEDIAN * pm_box_of(later, miss).median / (NORMAL_MEAN * distance);
    }
    free(y);
    return error;
}

double pm_estimate_coverage(const pm_estimate *e, const pm_observation *o,
                            const pm_dataset *dataset, const int *which, double seconds, int column,
                            double width) {
    long inside = 0, all = 0;
    for (int i = 0; i < e->count && e->deviation != NULL; ++i) {
        for (int k = 0; k < e->ntime; ++k) {
            const double y = later_sample(e, o, dataset, which[i], seconds, k, column);
            const ptrdiff_t at = ((ptrdiff_t)i * e->ntime + k) * e->ny + column;
            inside += !isnan(y) && fabs(e->y[at] - y) <= width * e->deviation[at];
            all += !isnan(y);
        }
    }
    return all > 0 ? (double)inside / (double)all : NAN;
}
