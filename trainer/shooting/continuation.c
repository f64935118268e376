// Window lengths double from point to point, and the weight of gaps rises at the same time. The
// first points take as many tracks as the weights need, and each that follows takes twice as many.
// Windows stay short where the system amplifies a change of the start too much for a longer one.
#include "shooting/continuation.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/linalg.h"
#include "base/rng.h"

#define SHORTEST 4 // samples of the first windows, if they can be integrated
// Gaps count like residuals of this many deviations of the noise at first.
#define FIRST_GAP 3.0
// The first windows cover at least FEWEST_TRACKS tracks, with at least MEASUREMENTS_PER_WEIGHT
// measurements for each weight.
#define FEWEST_TRACKS 4
#define MEASUREMENTS_PER_WEIGHT 20
#define GAP_FALLS 0.3 // factor from point to point
// Windows double while their gaps, as large as they become until the end of the next window, stay
// below this many deviations of the noise.
#define MOST_GROWN_GAP 10
#define WIDER 3.0  // deviation of later starts from the guess, in units of what they are off by
#define BEYOND 2.0 // given deviations of first starts, beyond which the data ask for a wider prior
#define COARSER 2  // the factor between the steps of the integrator in the first windows and later
// A point goes on while its steps still lower the objective: what short windows leave wrong along a
// direction that the data hardly determine, long windows repair only in tiny steps.
#define POINT_ITERATIONS 100
#define POINT_ENOUGH 1e-2
#define LAST_ITERATIONS 200
#define LAST_ENOUGH 1e-4
// A point goes on with the new noise until its relative change is below this.
#define MOST_ROUNDS 8
#define LAST_ROUNDS 3
#define POINT_SETTLED 0.2
#define LAST_SETTLED 0.02
// Noise below this fraction of the deviation of a column is rounding of the data.
#define LEAST_NOISE 1e-7
// Hidden components count as known to this fraction of their typical size, in relation to the mean
// relative noise of the measured ones.
#define NORMAL_MEDIAN 1.4826022185056018
// If windows cannot be integrated: how often substeps are doubled, how often the distance
// of the weights from their declared values is halved, and how often other starts are drawn.
#define FEW_FINER 1
#define MOST_FINER 5
#define MOST_CALMER 8
#define MOST_DRAWS 64
#define ASTRAY 1e4 // residual in deviations of its column

// --- noise ---

// Estimates the noise of every column from the median absolute residual. Given noise counts in the
// last point; before, residuals contain what is still wrong with the model, too.
// Raises *change to the largest relative change; `change` may be NULL.
static pm_status update_noise(pm_shooting *s, const pm_continuation *continuation, bool last,
                              double *change) {
    size_t most = 1;
    for (int i = 0; i < s->tracks->count; ++i) {
        most += (size_t)s->tracks->track[i].count;
    }
    double *size = malloc(most * sizeof *size);
    PM_TRY(size != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for an estimate of noise"));
    for (int c = 0; c < s->ny; ++c) {
        size_t n = 0;
        for (int i = 0; i < s->tracks->count; i += s->stride) {
            const pm_track *r = &s->tracks->track[i];
            for (int k = 0; k < r->count; ++k) {
                const ptrdiff_t at = (ptrdiff_t)k * s->ny + c;
                if (isfinite(r->y[at])) {
                    size[n++] = fabs(s->residual[i][at]);
                }
            }
        }
        pm_sort((size_t)n, size);
        const double least =
            (last ? LEAST_NOISE : PM_CONTINUATION_EARLY_NOISE) * s->tracks->deviation[c];
        const double estimate = n == 0 ? least : NORMAL_MEDIAN * size[n / 2];
        const double given = continuation->given[c];
        const double noise = given > 0 && last ? given : fmax(fmax(estimate, least), given);
        if (change != NULL) {
            *change = fmax(*change, fabs(noise / s->terms.noise[c] - 1));
        }
        s->terms.noise[c] = noise;
    }
    free(size);
    return PM_OK;
}

// Sets by what gaps are divided: `factor` times the noise of the component's column, or for hidden
// components their size times the mean relative noise.
static void set_gaps(pm_shooting *s, const pm_continuation *continuation, double factor) {
    double logarithm = 0;
    for (int c = 0; c < s->ny; ++c) {
        logarithm += log(s->terms.noise[c] / s->tracks->deviation[c]) / s->ny;
    }
    for (int c = 0; c < s->nz; ++c) {
        // The size of the changes of component c over all windows. As long as all windows
        // start at the guess, this is the size that the scene expects.
        double sum = 0, square = 0;
        for (int w = 0; w < s->nwindow; ++w) {
            const double z = s->z[(ptrdiff_t)w * s->nz + c];
            sum += z;
            square += z * z;
        }
        const double mean = sum / s->nwindow;
        const double deviation = sqrt(fmax(square / s->nwindow - mean * mean, 0));
        const double typical = fmax(continuation->typical[c], 0);
        const double size = deviation > 0 ? fmax(deviation, 1e-3 * typical) : typical;
        s->terms.gap[c] = factor * exp(logarithm) * (size > 0 ? size : 1);
    }
    for (int c = 0; c < s->ny; ++c) {
        if (s->observation->component[c] >= 0) {
            s->terms.gap[s->observation->component[c]] = factor * s->terms.noise[c];
        }
    }
}

// Lets the starts of windows be as far from the guess as hidden components have moved, once
// they have moved further than the deviation of the first start: this prior is about the start of a
// trajectory, and knows nothing of what happens after it.
// Returns the largest relative change.
static double widen_later_priors(pm_shooting *s) {
    double change = 0;
    for (int c = 0; c < s->nz; ++c) {
        double square = 0;
        long count = 0;
        for (int w = 0; w < s->nwindow; ++w) {
            const double d = s->z[(ptrdiff_t)w * s->nz + c] - s->observation->guess[c];
            square += s->window[w].follows ? d * d : 0;
            count += s->window[w].follows;
        }
        // The first start itself may be further away than the scene says, too. What it says is kept
        // unless the data clearly ask for more at the end, when the weights are known.
        double first = 0;
        long ntrack = 0;
        for (int w = 0; w < s->nwindow; ++w) {
            const double d = s->z[(ptrdiff_t)w * s->nz + c] - s->observation->guess[c];
            first += s->window[w].follows ? 0 : d * d;
            ntrack += !s->window[w].follows;
        }
        first = ntrack > 0 ? sqrt(first / (double)ntrack) : 0;
        const double given = s->observation->deviation[c];
        if (!s->terms.early && s->terms.prior[c] > 0 && first > BEYOND * given) {
            s->terms.prior[c] = fmax(s->terms.prior[c], WIDER * first);
        }
        const double moved = count > 0 ? sqrt(square / (double)count) : 0,
                     before = s->terms.later[c];
        s->terms.later[c] =
            s->terms.prior[c] > 0 && moved > s->terms.prior[c] ? WIDER * moved : s->terms.prior[c];
        change = fmax(change, before > 0 ? fabs(s->terms.later[c] / before - 1) : 0);
    }
    return change;
}

// --- points ---

// The root mean square gap in units of the noise.
static double gap_size(const pm_shooting *s, double factor) {
    double square = 0;
    long count = 0;
    for (int w = 0; w + 1 < s->nwindow; ++w) {
        for (int c = 0; c < s->nz && !s->window[w].ends; ++c) {
            const ptrdiff_t at = (ptrdiff_t)w * s->nz + c;
            const double r = (s->end[at] - s->z[at + s->nz]) / s->terms.gap[c] * factor;
            square += r * r;
            ++count;
        }
    }
    return count > 0 ? sqrt(square / (double)count) : 0;
}

// By how much errors of starts, in units of the gaps, grow until the second half of a window, in
// units of the noise: what nine of ten windows do not exceed.
static double growth(const pm_shooting *s, double factor) {
    double *size = malloc((size_t)s->nwindow * sizeof *size);
    for (int w = 0; w < s->nwindow && size != NULL; ++w) {
        const pm_window *window = &s->window[w];
        const double *y = s->tracks->track[window->track].y, *row = s->row[window->track];
        const ptrdiff_t middle = (window->first + window->last) / 2;
        size[w] = 0;
        for (ptrdiff_t at = middle * s->ny; at < (ptrdiff_t)window->last * s->ny; ++at) {
            const double *own = row + at * s->nrow;
            const double unit = own[s->nrow - 1] * s->terms.noise[at % s->ny] * factor;
            for (int k = 0; k < s->nz && isfinite(y[at]); ++k) {
                size[w] = fmax(size[w], fabs(own[k]) * s->terms.gap[k] / unit);
            }
        }
    }
    if (size != NULL) {
        pm_sort((size_t)s->nwindow, size);
    }
    const double most = size == NULL ? INFINITY : size[9 * s->nwindow / 10];
    free(size);
    return most;
}

int pm_continuation_first_length(const pm_shooting *s) {
    const int length = (2 * s->nz + s->ny - 1) / s->ny;
    return length > SHORTEST ? length : SHORTEST;
}

// A point in progress.
typedef struct running_point {
    const pm_continuation *continuation;
    pm_continuation_point *point;
} running_point;

static pm_status keep_progress(void *context, const pm_shooting_progress *progress) {
    const running_point *r = context;
    r->point->progress = *progress;
    return r->continuation->keep == NULL
               ? PM_OK
               : r->continuation->keep(r->continuation->context, r->point);
}

static pm_status run_point(pm_shooting *s, const pm_continuation *continuation,
                           pm_continuation_point *point) {
    int iterations = 0;
    const clock_t started = clock();
    const bool last = point->stage == PM_CONTINUATION_LAST;
    bool settled = false;
    running_point running = {continuation, point};
    const bool long_last = last && !continuation->brief;
    const pm_shooting_limits limits = {.iterations = long_last ? LAST_ITERATIONS : POINT_ITERATIONS,
                                       .enough = long_last ? LAST_ENOUGH : POINT_ENOUGH,
                                       .stop = continuation->stop,
                                       .work = continuation->work,
                                       .keep = keep_progress,
                                       .context = &running};
    pm_shooting_progress progress = point->progress;
    if (point->round == 0 && progress.iterations == 0) {
        widen_later_priors(s);
    }
    if (continuation->loud) {
        snprintf(s->label, sizeof s->label, "windows of %d", point->length);
    }
    for (; point->round < (last ? LAST_ROUNDS : MOST_ROUNDS) && !settled; ++point->round) {
        if (progress.iterations == 0) {
            set_gaps(s, continuation, point->factor);
        }
        PM_TRY(pm_shooting_minimise(s, &limits, &point->damping, &progress));
        iterations += progress.iterations;
        point->after = progress.after;
        progress = (pm_shooting_progress){0};
        double change = s->terms.everywhere ? widen_later_priors(s) : 0;
        PM_TRY(update_noise(s, continuation, last, &change));
        settled = change < (last ? LAST_SETTLED : POINT_SETTLED);
    }
    point->round = 0;
    point->progress = progress;
    point->gap = gap_size(s, point->factor);
    if (continuation->loud) {
        double noise = 0;
        for (int c = 0; c < s->ny; ++c) {
            noise += log(s->terms.noise[c] / s->tracks->deviation[c]) / s->ny;
        }
        printf("%s of %-6d %8d iteration%s %8.2f s of CPU   %d window%s, residual %.3g %% of the "
               "deviation, gaps %.2g of the noise\n",
               s->terms.hold ? "starts, windows" : "windows", point->length, iterations,
               iterations == 1 ? " " : "s", ((double)(clock() - started) / CLOCKS_PER_SEC),
               s->nwindow, s->nwindow == 1 ? "" : "s", 100 * exp(noise), point->gap);
        fflush(stdout);
    }
    return PM_OK;
}

static bool hides(const pm_shooting *s) {
    bool hidden = false;
    for (int c = 0; c < s->nz; ++c) {
        hidden = hidden || s->observation->hidden[c];
    }
    return hidden;
}

// Prepares the shooting for a stage of the continuation with `substeps` steps of the integrator at
// the end.
static void begin_stage(pm_shooting *s, int stage, int substeps) {
    // Starts come first: hidden components begin as guesses, to which the weights must not adapt.
    s->terms.hold = stage == PM_CONTINUATION_STARTS || stage == PM_CONTINUATION_JOIN;
    // Until the noise is known, directions that the data hardly determine must not wander.
    s->terms.early = stage != PM_CONTINUATION_LAST;
    // Where gaps hardly count, priors keep the starts of all windows from making up for the
    // weights.
    s->terms.everywhere = stage == PM_CONTINUATION_STARTS || stage == PM_CONTINUATION_SHORT;
    // Long windows multiply the errors of long steps: trajectories that were found with them would
    // be too far from those with short steps to lead there.
    const int own = s->terms.everywhere ? (substeps + COARSER - 1) / COARSER : substeps;
    if (own != s->how.substeps) {
        pm_shooting_set_substeps(s, own);
    }
}

int pm_continuation_longest(const pm_shooting *s) {
    int longest = 0;
    for (int i = 0; i < s->tracks->count; ++i) {
        longest = s->tracks->track[i].count > longest ? s->tracks->track[i].count : longest;
    }
    return longest;
}

// Changes the windows. Keeps the old ones if the new ones cannot be integrated.
static pm_status divide(pm_shooting *s, pm_continuation_point *point, int length, int stride,
                        bool *changed) {
    const size_t size = (size_t)s->nwindow * (size_t)s->nz * sizeof *s->z;
    double *kept = calloc(1, size);
    PM_TRY(pm_allocated(kept, "the starts of windows"));
    memcpy(kept, s->z, size);
    s->stride = stride;
    pm_status status = pm_shooting_divide(s, length);
    if (status == PM_OK) {
        *changed = isfinite(pm_shooting_evaluate(s, s->z, false));
        status = s->failed;
    }
    if (status == PM_OK && *changed) {
        point->length = length;
        point->stride = stride;
    } else if (status == PM_OK) {
        s->stride = point->stride;
        status = pm_shooting_divide(s, point->length);
        if (status == PM_OK) {
            memcpy(s->z, kept, size);
            pm_shooting_evaluate(s, s->z, false);
            status = s->failed;
        }
    }
    free(kept);
    return status;
}

// The weights need few tracks at first.
static int first_stride(const pm_shooting *s) {
    double measurements = 0;
    int stride = 1;
    for (int i = 0; i < s->tracks->count; ++i) {
        measurements += (double)s->tracks->track[i].count * s->ny / s->tracks->count;
    }
    const double needed = MEASUREMENTS_PER_WEIGHT * s->nweight / measurements;
    while (s->tracks->count >= 2 * stride * fmax(needed, FEWEST_TRACKS)) {
        stride *= 2;
    }
    return stride;
}

// Returns whether all windows can be integrated. One that has gone astray cannot be meant, although
// it is finite: steps are too long for a law, or a constant that fits other windows does not fit
// it.
static bool integrates(pm_shooting *s) {
    bool near = isfinite(pm_shooting_evaluate(s, s->z, false));
    for (int c = 0; c < s->ny && near; ++c) {
        const double most = ASTRAY * s->tracks->deviation[c];
        const int component = s->observation->component[c];
        for (int i = 0; i < s->tracks->count; i += s->stride) {
            for (int k = 0; k < s->tracks->track[i].count; ++k) {
                near = near && !(fabs(s->residual[i][(ptrdiff_t)k * s->ny + c]) > most);
            }
        }
        for (int w = 0; w + 1 < s->nwindow && component >= 0; ++w) {
            const ptrdiff_t at = (ptrdiff_t)w * s->nz + component;
            near = near && (s->window[w].ends || !(fabs(s->end[at] - s->z[at + s->nz]) > most));
        }
    }
    return near;
}

// Draws the hidden components of the starts of all windows that cannot be integrated, about their
// guess. Returns whether all windows can be integrated then.
static bool draw_starts(pm_shooting *s) {
    bool finite = false;
    for (int i = 0; i < MOST_DRAWS && !finite && s->failed == PM_OK; ++i) {
        for (int w = 0; w < s->nwindow; ++w) {
            double *z = s->z + (ptrdiff_t)w * s->nz, sum = 0;
            pm_rng rng;
            pm_rng_init(&rng, (uint64_t)i, (uint64_t)w);
            for (int c = 0; c < s->nz; ++c) {
                sum += s->end[(ptrdiff_t)w * s->nz + c];
            }
            for (int c = 0; c < s->nz && !isfinite(sum); ++c) {
                const double away = s->observation->deviation[c] * pm_rng_normal(&rng);
                z[c] = s->observation->hidden[c] ? s->observation->guess[c] + away : z[c];
            }
        }
        finite = isfinite(pm_shooting_evaluate(s, s->z, false));
    }
    return finite;
}

// Takes more substeps, up to `most` doublings, until all windows can be integrated. Returns
// whether they can; else the substeps stay as they were.
static bool refine(pm_shooting *s, pm_continuation_point *p, int substeps, int most) {
    const int before = p->finer;
    bool finite = false;
    for (int i = 0; i < most && !finite && s->nweight > 0 && s->failed == PM_OK; ++i) {
        ++p->finer;
        begin_stage(s, p->stage, substeps << p->finer);
        finite = integrates(s);
        if (finite) {
            printf("The steps are too long for the model: %d substeps are taken.\n",
                   substeps << p->finer);
        }
    }
    if (!finite) {
        p->finer = before;
        begin_stage(s, p->stage, substeps << before);
    }
    return finite;
}

// Makes all windows integrable: with a few more substeps, with weights that are closer to
// their declared values, with many more substeps, which cost as much time in all that follows, or
// else with other starts.
static pm_status calm(pm_shooting *s, pm_continuation_point *p, int substeps) {
    double *theta = malloc((size_t)s->nborder * sizeof *theta);
    PM_TRY(theta != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for weights"));
    pm_shooting_weights(s, theta);
    bool finite = integrates(s);
    finite = finite || refine(s, p, substeps, FEW_FINER);
    for (int i = 0; i < MOST_CALMER && !finite && s->failed == PM_OK; ++i) {
        for (int k = 0; k < s->nweight; ++k) {
            theta[k] = 0.5 * (theta[k] + s->terms.first_weight[k]);
        }
        pm_shooting_set_weights(s, theta);
        finite = integrates(s);
    }
    free(theta);
    finite = finite || refine(s, p, substeps, MOST_FINER) || (hides(s) && draw_starts(s));
    PM_TRY(s->failed);
    return finite ? PM_OK
                  : pm_fail(PM_ENUMERIC, "windows of %d samples cannot be integrated", p->length);
}

// Divides the tracks into windows of the length of the point, or into shorter ones, so that they
// can be integrated.
static pm_status divide_calmly(pm_shooting *s, const pm_continuation *continuation,
                               pm_continuation_point *p, int substeps) {
    const double most = continuation->work > 0 ? continuation->work : INFINITY;
    s->stride = p->stride;
    PM_TRY(pm_shooting_divide(s, p->length));
    pm_status status = calm(s, p, substeps);
    while (status == PM_ENUMERIC && p->length > PM_CONTINUATION_LEAST && s->work < most) {
        p->length = p->length / 2 > PM_CONTINUATION_LEAST ? p->length / 2 : PM_CONTINUATION_LEAST;
        PM_TRY(pm_shooting_divide(s, p->length));
        status = calm(s, p, substeps);
    }
    return status;
}

// Takes the shortest windows in place of first ones in which the noise of a measured start grows
// too much: a fit that began with them would bend the weights to trajectories whose starts it does
// not know.
static pm_status shorten(pm_shooting *s, const pm_continuation *continuation,
                         pm_continuation_point *p, int substeps) {
    const int shortest = pm_continuation_first_length(s);
    if (p->length <= shortest) {
        return PM_OK;
    }
    const bool hold = s->terms.hold;
    set_gaps(s, continuation, 1);
    s->terms.hold = true;
    pm_shooting_evaluate(s, s->z, true);
    s->terms.hold = hold;
    PM_TRY(s->failed);
    if (growth(s, 1) <= MOST_GROWN_GAP) {
        return PM_OK;
    }
    p->length = shortest;
    PM_TRY(divide_calmly(s, continuation, p, substeps));
    return update_noise(s, continuation, false, NULL);
}

// Chooses the point after one that has ended.
static pm_status next_point(pm_shooting *s, const pm_continuation *continuation,
                            pm_continuation_point *point, int substeps) {
    if (point->stage == PM_CONTINUATION_STARTS || point->stage == PM_CONTINUATION_JOIN) {
        point->stage =
            point->stage == PM_CONTINUATION_STARTS ? PM_CONTINUATION_SHORT : PM_CONTINUATION_GROW;
        point->damping = 0;
        return PM_OK;
    }
    if (point->stage == PM_CONTINUATION_LAST) {
        point->stage = PM_CONTINUATION_DONE;
        return PM_OK;
    }
    point->stage = PM_CONTINUATION_GROW;
    const bool closed = point->factor <= PM_CONTINUATION_LAST_GAP;
    const bool joins = growth(s, point->factor) * gap_size(s, point->factor) < MOST_GROWN_GAP;
    const bool longest = point->length >= pm_continuation_longest(s);
    bool changed = false;
    if (!longest && joins) {
        PM_TRY(divide(s, point, 2 * point->length, point->stride, &changed));
    }
    // Windows grow with few tracks, which tell the weights nearly as well as all and take less
    // time. Tracks are added where windows cannot grow, if need be with shorter windows, or with
    // weights that have not adapted so far to the tracks before.
    if (!changed && point->stride > 1) {
        point->stride /= 2;
        PM_TRY(divide_calmly(s, continuation, point, substeps));
        changed = true;
        point->stage = hides(s) ? PM_CONTINUATION_JOIN : PM_CONTINUATION_GROW;
    }
    // Once every track is one window, there is no gap left to close.
    const bool ends = !changed && (longest || closed);
    if (ends) {
        point->stage = PM_CONTINUATION_LAST;
        return update_noise(s, continuation, true, NULL);
    }
    point->factor = fmax(point->factor * GAP_FALLS, PM_CONTINUATION_LAST_GAP);
    return PM_OK;
}

pm_status pm_continuation_run(pm_shooting *s, const pm_continuation *continuation,
                              pm_continuation_point *last) {
    const int substeps = s->how.substeps;
    pm_continuation_point point = continuation->first_point;
    if (point.stage == PM_CONTINUATION_NONE) {
        // Divides the tracks into the first windows. Noise is at first what the model as it is
        // leaves unexplained, so that no residual counts as an outlier before the model is any
        // good.
        pm_continuation_point *p = &point;
        *p = (pm_continuation_point){
            .stage = hides(s) ? PM_CONTINUATION_STARTS : PM_CONTINUATION_SHORT,
            .length =
                continuation->first > 0 ? continuation->first : pm_continuation_first_length(s),
            .factor = FIRST_GAP,
            .stride = first_stride(s)};
        begin_stage(s, p->stage, substeps);
        PM_TRY(divide_calmly(s, continuation, p, substeps));
        PM_TRY(update_noise(s, continuation, false, NULL));
        PM_TRY(shorten(s, continuation, p, substeps));
    }
    while (point.stage != PM_CONTINUATION_DONE) {
        begin_stage(s, point.stage, substeps << point.finer);
        PM_TRY(continuation->keep == NULL ? PM_OK
                                          : continuation->keep(continuation->context, &point));
        PM_TRY(run_point(s, continuation, &point));
        PM_TRY(next_point(s, continuation, &point, substeps));
        if (continuation->work > 0 && s->work > continuation->work) {
            point.stage = PM_CONTINUATION_DONE;
        }
    }
    if (last != NULL) {
        *last = point;
    }
    return continuation->keep == NULL ? PM_OK : continuation->keep(continuation->context, &point);
}
