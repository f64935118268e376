// Window lengths double from level to level, and the weight of gaps rises at the same time. Windows
// stay short where the flow amplifies a change of the start too much for a longer one.
#include "learn/shooting_schedule.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/progress.h"

// Gaps count like residuals of this many deviations of the noise, first and at the end.
#define FIRST_GAP 3.0
#define LAST_GAP 0.03
#define GAP_FALLS 0.3 // factor from level to level
// Windows double while their gaps, as large as they become until the end of the next window, stay
// below this many deviations of the noise.
#define MOST_GROWN_GAP 10
#define SHORTEST 4 // samples of the first windows, at least
#define COARSER 2  // the factor between the steps of the integrator in the first windows and later
#define LEVEL_ITERATIONS 12
#define LEVEL_ENOUGH 1e-2
#define LAST_ITERATIONS 40
#define LAST_ENOUGH 1e-4
// A level goes on with the new noise until its relative change is below this.
#define MOST_ROUNDS 8
#define LAST_ROUNDS 3
#define LEVEL_SETTLED 0.2
#define LAST_SETTLED 0.02
// Noise below this fraction of the deviation of a column is rounding of the data.
#define LEAST_NOISE 1e-7
// Before the last level residuals count as noise of at least this fraction of a deviation. Clean
// data would otherwise demand of short windows what the weights cannot fulfil yet.
#define LEAST_EARLY_NOISE 3e-3
// Hidden components count as known to this fraction of their typical size, in relation to the mean
// relative noise of the measured ones.
#define NORMAL_MEDIAN 1.4826022185056018

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

// --- noise ---

// Estimates the noise of every column from the median absolute residual. Given noise counts in the
// last level; before, residuals contain what is still wrong with the model, too.
// Raises *change to the largest relative change; `change` may be NULL.
static pm_status update_noise(pm_shooting *s, const pm_shooting_course *course, bool last,
                              double *change) {
    size_t most = 1;
    for (int i = 0; i < s->tracks->count; ++i) {
        most += (size_t)s->tracks->track[i].count;
    }
    double *size = malloc(most * sizeof *size);
    if (size == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an estimate of noise");
    }
    for (int c = 0; c < s->ny; ++c) {
        size_t n = 0;
        for (int i = 0; i < s->tracks->count; ++i) {
            const pm_track *r = &s->tracks->track[i];
            for (int k = 0; k < r->count; ++k) {
                const ptrdiff_t at = (ptrdiff_t)k * s->ny + c;
                if (isfinite(r->y[at])) {
                    size[n++] = fabs(s->residual[i][at]);
                }
            }
        }
        qsort(size, n, sizeof *size, compare);
        const double least = (last ? LEAST_NOISE : LEAST_EARLY_NOISE) * s->tracks->deviation[c];
        const double estimate = n == 0 ? least : NORMAL_MEDIAN * size[n / 2];
        const double given = course->given[c];
        const double noise = given > 0 && last ? given : fmax(fmax(estimate, least), given);
        if (change != NULL) {
            *change = fmax(*change, fabs(noise / s->noise[c] - 1));
        }
        s->noise[c] = noise;
    }
    free(size);
    return PM_OK;
}

// The size of the changes of component c over all windows, or what is known of it before.
static double size_of(const pm_shooting *s, const pm_shooting_course *course, int c) {
    double sum = 0, square = 0;
    for (int w = 0; w < s->nwindow; ++w) {
        const double z = s->z[(ptrdiff_t)w * s->nz + c];
        sum += z;
        square += z * z;
    }
    const double mean = sum / s->nwindow;
    const double deviation = sqrt(fmax(square / s->nwindow - mean * mean, 0));
    return fmax(deviation, course->typical[c] > 0 ? 1e-3 * course->typical[c] : 0);
}

// Sets by what gaps are divided: `factor` times the noise of the component's column, or for hidden
// components their size times the mean relative noise.
static void set_gaps(pm_shooting *s, const pm_shooting_course *course, double factor) {
    double logarithm = 0;
    for (int c = 0; c < s->ny; ++c) {
        logarithm += log(s->noise[c] / s->tracks->deviation[c]) / s->ny;
    }
    for (int c = 0; c < s->nz; ++c) {
        const double size = size_of(s, course, c);
        s->gap[c] = factor * exp(logarithm) * (size > 0 ? size : 1);
    }
    for (int c = 0; c < s->ny; ++c) {
        if (s->observation->component[c] >= 0) {
            s->gap[s->observation->component[c]] = factor * s->noise[c];
        }
    }
}

// --- levels ---

// The root mean square gap in units of the noise.
static double gap_size(const pm_shooting *s, double factor) {
    double square = 0;
    long count = 0;
    for (int w = 0; w + 1 < s->nwindow; ++w) {
        for (int c = 0; c < s->nz && !s->window[w].ends; ++c) {
            const ptrdiff_t at = (ptrdiff_t)w * s->nz + c;
            const double r = (s->end[at] - s->z[at + s->nz]) / s->gap[c] * factor;
            square += r * r;
            ++count;
        }
    }
    return count > 0 ? sqrt(square / (double)count) : 0;
}

// The growth of changes from start to end in units of the gaps, which nine of ten windows do not
// exceed.
static double growth(const pm_shooting *s) {
    double *size = malloc((size_t)s->nwindow * sizeof *size);
    int n = 0;
    for (int w = 0; w < s->nwindow && size != NULL; ++w) {
        double largest = 0;
        for (int i = 0; i < s->nz && !s->window[w].ends; ++i) {
            for (int k = 0; k < s->nz; ++k) {
                const double d = s->end_by_start[((ptrdiff_t)w * s->nz + i) * s->nz + k];
                largest = fmax(largest, fabs(d) * s->gap[k]);
            }
        }
        if (!s->window[w].ends) {
            size[n++] = largest;
        }
    }
    qsort(size, (size_t)n, sizeof *size, compare);
    const double most = n > 0 ? size[9 * n / 10] : 0;
    free(size);
    return most;
}

static void print_level(const pm_shooting *s, int length, double factor,
                        const pm_shooting_progress *p, double seconds) {
    double noise = 0;
    for (int c = 0; c < s->ny; ++c) {
        noise += log(s->noise[c] / s->tracks->deviation[c]) / s->ny;
    }
    printf("%s of %-6d %8d iterations %8.1f s   %d windows, objective %.4e to %.4e, residual "
           "%.3g %% of the deviation, gaps %.2g of the noise\n",
           s->hold ? "starts, windows" : "windows", length, p->iterations, seconds, s->nwindow,
           p->before, p->after, 100 * exp(noise), gap_size(s, factor));
    fflush(stdout);
}

int pm_shooting_first_length(const pm_shooting *s) {
    const int length = (2 * s->nz + s->ny - 1) / s->ny;
    return length > SHORTEST ? length : SHORTEST;
}

static int longest_record(const pm_shooting *s) {
    int longest = 0;
    for (int i = 0; i < s->tracks->count; ++i) {
        longest = s->tracks->track[i].count > longest ? s->tracks->track[i].count : longest;
    }
    return longest;
}

static pm_status run_level(pm_shooting *s, const pm_shooting_course *course, int length,
                           double factor, bool last, double *damping) {
    pm_shooting_progress all = {0};
    const double started = pm_clock();
    bool settled = false;
    for (int round = 0; round < (last ? LAST_ROUNDS : MOST_ROUNDS) && !settled; ++round) {
        pm_shooting_progress progress;
        set_gaps(s, course, factor);
        PM_TRY(pm_shooting_minimise(s, last ? LAST_ITERATIONS : LEVEL_ITERATIONS,
                                    last ? LAST_ENOUGH : LEVEL_ENOUGH, damping, course->stop,
                                    &progress));
        all.before = round == 0 ? progress.before : all.before;
        all.after = progress.after;
        all.iterations += progress.iterations;
        double change = 0;
        PM_TRY(update_noise(s, course, last, &change));
        settled = change < (last ? LAST_SETTLED : LEVEL_SETTLED);
    }
    if (course->loud) {
        print_level(s, length, factor, &all, pm_clock() - started);
    }
    return PM_OK;
}

pm_status pm_shooting_run(pm_shooting *s, const pm_shooting_course *course) {
    int length = course->first > 0 ? course->first : pm_shooting_first_length(s);
    const int longest = longest_record(s), substeps = s->how.substeps;
    double factor = FIRST_GAP, damping = 0;
    PM_TRY(pm_shooting_set_substeps(s, (substeps + COARSER - 1) / COARSER));
    PM_TRY(pm_shooting_divide(s, length));
    // Noise is at first what the model as it is leaves unexplained, so that no residual counts as
    // an outlier before the model is any good.
    pm_shooting_evaluate(s, s->z, false);
    PM_TRY(update_noise(s, course, false, NULL));
    // Starts come first: hidden components begin as guesses, to which the weights must not adapt.
    // Where gaps hardly count, priors keep the starts of all windows from making up for the
    // weights.
    s->hold = s->everywhere = true;
    PM_TRY(run_level(s, course, length, factor, false, &damping));
    s->hold = false;
    damping = 0;
    PM_TRY(run_level(s, course, length, factor, false, &damping));
    s->everywhere = false;
    // Long windows multiply the errors of long steps: trajectories that were found with them would
    // be too far from those with short steps to lead there.
    PM_TRY(pm_shooting_set_substeps(s, substeps));
    // Once every track is one window, there is no gap left to close.
    while (length < longest) {
        const bool closed = factor <= LAST_GAP;
        const bool joins = growth(s) * gap_size(s, factor) < MOST_GROWN_GAP;
        if (closed && !joins) {
            break;
        }
        factor = fmax(factor * GAP_FALLS, LAST_GAP);
        if (joins) {
            length *= 2;
            PM_TRY(pm_shooting_divide(s, length));
        }
        PM_TRY(run_level(s, course, length, factor, false, &damping));
    }
    PM_TRY(update_noise(s, course, true, NULL));
    return run_level(s, course, length, factor, true, &damping);
}
