// The covariance of the weights, its file, and what it says in the names of the scene.
#include "learn/uncertainty.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/linalg.h"
#include "learn/training.h"
#include "store/hdf5_io.h"

#define FILE_NAME "measured.h5"
// Lags of the autocorrelation, until it falls below a limit.
#define MOST_LAGS 400
#define LEAST_CORRELATION 0.05
// A start, or a weight, keeps at least this part of the deviation of its prior if the data tell
// nothing about it.
#define PRIOR_ALONE 0.5
// Fewer trajectories than this do not show by themselves how much trajectories disagree.
#define FEWEST_COMPARED 5
// Of a normal distribution: the standard deviation divided by the median absolute value.
#define NORMAL_MEDIAN 1.4826022185056018

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for uncertainties");
}

// --- autocorrelation ---

// The mean product of residuals that are `lag` samples apart, in units of the noise.
static double correlation(const pm_shooting *s, int lag) {
    double sum = 0, square = 0;
    for (int i = 0; i < s->tracks->count; ++i) {
        const pm_track *t = &s->tracks->track[i];
        for (int k = 0; k < t->count; ++k) {
            for (int c = 0; c < s->ny; ++c) {
                const ptrdiff_t at = (ptrdiff_t)k * s->ny + c, later = at + (ptrdiff_t)lag * s->ny;
                if (k + lag >= t->count || !isfinite(t->y[at]) || !isfinite(t->y[later])) {
                    continue;
                }
                const double a = s->residual[i][at] / s->noise[c];
                const double b = s->residual[i][later] / s->noise[c];
                sum += a * b;
                square += 0.5 * (a * a + b * b);
            }
        }
    }
    return square > 0 ? sum / square : 0;
}

static double samples_per_residual(const pm_shooting *s) {
    double sum = 1;
    for (int lag = 1; lag <= MOST_LAGS; ++lag) {
        const double r = correlation(s, lag);
        if (r < LEAST_CORRELATION) {
            break;
        }
        sum += 2 * r;
    }
    return sum;
}

// --- independent noise ---

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

// Returns the standard deviation of the part of the residuals of a column that differs from sample
// to sample, from the median difference of neighbouring residuals. `size` is work space for all
// samples.
static double independent_noise(const pm_shooting *s, int column, double *size) {
    size_t n = 0;
    for (int i = 0; i < s->tracks->count; ++i) {
        const pm_track *t = &s->tracks->track[i];
        for (int k = 0; k + 1 < t->count; ++k) {
            const ptrdiff_t at = (ptrdiff_t)k * s->ny + column, next = at + s->ny;
            if (isfinite(t->y[at]) && isfinite(t->y[next])) {
                size[n++] = fabs(s->residual[i][next] - s->residual[i][at]);
            }
        }
    }
    qsort(size, n, sizeof *size, compare);
    const double all = s->noise[column];
    return n == 0 ? all : fmin(NORMAL_MEDIAN / sqrt(2) * size[n / 2], all);
}

static pm_status find_independent_noise(pm_uncertainty *u, const pm_shooting *s) {
    size_t most = 1;
    for (int i = 0; i < s->tracks->count; ++i) {
        most += (size_t)s->tracks->track[i].count;
    }
    double *size = malloc(most * sizeof *size);
    if (size == NULL) {
        return no_memory();
    }
    for (int c = 0; c < u->ny; ++c) {
        u->independent[c] = independent_noise(s, c, size);
    }
    free(size);
    return PM_OK;
}

// --- disagreement of trajectories ---

// Whether every track is one window, so that its part of the equations can be evaluated alone.
static bool tracks_are_windows(const pm_shooting *s) {
    bool single = true;
    for (int w = 0; w < s->nwindow; ++w) {
        single = single && !s->window[w].follows && s->window[w].ends;
    }
    return single;
}

// Takes the influence of its start out of the gradient [nweight] of a track that is window w.
// Returns false if the start is free.
static bool eliminate_start(const pm_shooting *s, ptrdiff_t w, double *gradient) {
    const ptrdiff_t nz = s->nz, nb = s->nborder;
    double *own = s->own + w * nz * nz, *border = s->border + w * nz * nb;
    if (!pm_cholesky_factor(s->nz, own)) {
        return false;
    }
    double *start = s->factor; // own^-1 times the gradient by the start
    for (ptrdiff_t i = 0; i < nz; ++i) {
        start[i] = border[i * nb + s->nweight];
    }
    pm_cholesky_back(s->nz, own, 1, start);
    for (ptrdiff_t i = 0; i < nz; ++i) {
        for (ptrdiff_t k = 0; k < s->nweight; ++k) {
            gradient[k] -= border[i * nb + k] * start[i];
        }
    }
    return true;
}

// Computes the gradients [nwindow][nweight] of all tracks, each of which is a window. Returns false
// if a start is free.
static bool find_gradients(pm_shooting *s, double *gradient) {
    s->window_gradient = gradient;
    pm_shooting_evaluate(s, s->z, true);
    s->window_gradient = NULL;
    bool known = s->failed == PM_OK;
    for (ptrdiff_t w = 0; w < s->nwindow && known; ++w) {
        known = eliminate_start(s, w, gradient + w * s->nweight);
    }
    return known;
}

// Compares the gradients g of single trajectories with their covariance: the mean of g' H^-1 g over
// all directions that the data fix is 1 if trajectories differ by independent noise alone.
// `inverse` is H^-1 [nweight][nweight]. 0: not known.
static double disagreement(pm_shooting *s, const double *inverse) {
    const ptrdiff_t n = s->nweight;
    double *gradient = calloc((size_t)(s->nwindow * n) + 1, sizeof *gradient);
    double sum = 0, fixed = 0;
    const bool known =
        gradient != NULL && s->nwindow > 1 && tracks_are_windows(s) && find_gradients(s, gradient);
    for (int i = 0; i < s->nwindow && known; ++i) {
        const double *own = gradient + i * n;
        for (ptrdiff_t k = 0; k < n; ++k) {
            double product = 0;
            for (ptrdiff_t l = 0; l < n; ++l) {
                product += inverse[k * n + l] * own[l];
            }
            sum += own[k] * product;
        }
    }
    for (ptrdiff_t k = 0; k < n; ++k) {
        const double reach = s->reach[k];
        fixed += reach > 0 ? fmax(1 - inverse[k * (n + 1)] / (reach * reach), 0) : 1;
    }
    free(gradient);
    return known && fixed > 0.5 ? sum / fixed * s->nwindow / (s->nwindow - 1) : 0;
}

// --- making ---

// Inverts the Cholesky factor that the solution left in s->reduced.
static void invert(const pm_shooting *s, double factor, double *covariance) {
    const size_t n = (size_t)s->nweight;
    memset(covariance, 0, n * n * sizeof *covariance);
    for (size_t i = 0; i < n; ++i) {
        covariance[i * (n + 1)] = factor;
    }
    if (n > 0) {
        pm_cholesky_back(s->nweight, s->reduced, s->nweight, covariance);
    }
}

// The variance of component c of the start of window w, which is the first of its track: that at
// fixed weights and later starts. It is exact where the track is one window.
static double start_variance(const pm_shooting *s, int w, int c, double *work) {
    const ptrdiff_t nz = s->nz, nb = s->nborder;
    const double *u = s->factor + w * nz * nz;
    memset(work, 0, (size_t)(nz + nb) * sizeof *work);
    double *column = work + nb;
    column[c] = 1;
    pm_cholesky_back(s->nz, u, 1, column);
    return column[c];
}

static pm_status allocate(pm_uncertainty *u) {
    const size_t n = (size_t)u->nweight, nz = (size_t)u->nz;
    u->covariance = pm_arena_array(&u->arena, n * n + 1, sizeof *u->covariance);
    u->weights = pm_arena_array(&u->arena, n + 1, sizeof *u->weights);
    u->noise = pm_arena_array(&u->arena, (size_t)u->ny, sizeof *u->noise);
    u->independent = pm_arena_array(&u->arena, (size_t)u->ny, sizeof *u->independent);
    u->start = pm_arena_array(&u->arena, nz, sizeof *u->start);
    u->spread = pm_arena_array(&u->arena, nz, sizeof *u->spread);
    u->unknown = pm_arena_array(&u->arena, nz, sizeof *u->unknown);
    return u->covariance == NULL || u->weights == NULL || u->noise == NULL ||
                   u->independent == NULL || u->start == NULL || u->spread == NULL ||
                   u->unknown == NULL
               ? no_memory()
               : PM_OK;
}

// Mean and spread of the first starts, and how much of their priors they keep.
static pm_status describe_starts(pm_uncertainty *u, const pm_shooting *s) {
    double *work = malloc((size_t)(s->nz + s->nborder) * sizeof *work);
    if (work == NULL) {
        return no_memory();
    }
    for (int c = 0; c < s->nz; ++c) {
        double mean = 0, square = 0, variance = 0;
        int n = 0;
        for (int w = 0; w < s->nwindow; ++w) {
            if (!s->window[w].follows) {
                const double z = s->z[(ptrdiff_t)w * s->nz + c];
                mean += z;
                square += z * z;
                variance += start_variance(s, w, c, work);
                ++n;
            }
        }
        mean /= n;
        u->start[c] = mean;
        u->spread[c] = sqrt(fmax(square / n - mean * mean, 0));
        u->unknown[c] = s->prior[c] > 0 ? sqrt(variance / n) / s->prior[c] : 0;
    }
    free(work);
    return PM_OK;
}

static pm_status make(pm_uncertainty *u, pm_shooting *s) {
    const size_t n = (size_t)s->nweight + (size_t)s->nwindow * (size_t)s->nz;
    PM_TRY(allocate(u));
    double *step = malloc(n * sizeof *step);
    if (step == NULL) {
        return no_memory();
    }
    pm_shooting_evaluate(s, s->z, true);
    const bool solved = s->failed == PM_OK && pm_shooting_solve(s, 0, step, step + s->nweight);
    free(step);
    if (!solved) {
        PM_TRY(s->failed);
        return pm_fail(PM_ENUMERIC, "the measurements and the priors do not fix all weights");
    }
    u->samples_per_residual = samples_per_residual(s);
    invert(s, 1, u->covariance);
    pm_shooting_weights(s, u->weights);
    memcpy(u->noise, s->noise, (size_t)u->ny * sizeof *u->noise);
    PM_TRY(find_independent_noise(u, s));
    PM_TRY(describe_starts(u, s));
    const double ratio = disagreement(s, u->covariance);
    const bool compared = ratio > 0 && s->nwindow >= FEWEST_COMPARED;
    u->inflation = fmax(compared ? 1 : u->samples_per_residual, ratio);
    for (size_t i = 0; i < (size_t)u->nweight * (size_t)u->nweight; ++i) {
        u->covariance[i] *= u->inflation;
    }
    return PM_OK;
}

pm_status pm_uncertainty_make(pm_uncertainty *u, pm_shooting *s) {
    *u = (pm_uncertainty){.nweight = s->nweight, .ny = s->ny, .nz = s->nz, .scale = 1};
    const pm_status status = make(u, s);
    if (status != PM_OK) {
        pm_uncertainty_free(u);
    }
    return status;
}

void pm_uncertainty_free(pm_uncertainty *u) {
    pm_arena_free(&u->arena);
    *u = (pm_uncertainty){0};
}

// --- the file ---

static pm_status write_content(const pm_uncertainty *u, pm_hdf5 *file) {
    const int square[2] = {u->nweight, u->nweight};
    if (u->nweight > 0) {
        PM_TRY(pm_hdf5_write(file, "/covariance", 2, square, u->covariance));
        PM_TRY(pm_hdf5_write(file, "/weights", 1, square, u->weights));
    }
    PM_TRY(pm_hdf5_write(file, "/noise", 1, &u->ny, u->noise));
    PM_TRY(pm_hdf5_write(file, "/independent", 1, &u->ny, u->independent));
    PM_TRY(pm_hdf5_write(file, "/start", 1, &u->nz, u->start));
    PM_TRY(pm_hdf5_write(file, "/spread", 1, &u->nz, u->spread));
    PM_TRY(pm_hdf5_write(file, "/unknown", 1, &u->nz, u->unknown));
    PM_TRY(pm_hdf5_write_number(file, "/", "inflation", u->inflation));
    PM_TRY(pm_hdf5_write_number(file, "/", "scale", u->scale));
    return pm_hdf5_write_number(file, "/", "samples_per_residual", u->samples_per_residual);
}

pm_status pm_uncertainty_save(const pm_uncertainty *u, const char *folder) {
    char path[4096];
    pm_hdf5 *file = NULL;
    pm_status status;
    snprintf(path, sizeof path, "%s/" FILE_NAME, folder);
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    PM_TRY_DONE(write_content(u, file));
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    return status;
}

static pm_status read_content(pm_uncertainty *u, const pm_hdf5 *file) {
    const int square[2] = {u->nweight, u->nweight};
    PM_TRY(allocate(u));
    if (u->nweight > 0) {
        PM_TRY(pm_hdf5_read(file, "/covariance", 2, square, u->covariance));
        PM_TRY(pm_hdf5_read(file, "/weights", 1, square, u->weights));
    }
    PM_TRY(pm_hdf5_read(file, "/noise", 1, &u->ny, u->noise));
    PM_TRY(pm_hdf5_read(file, "/independent", 1, &u->ny, u->independent));
    PM_TRY(pm_hdf5_read(file, "/start", 1, &u->nz, u->start));
    PM_TRY(pm_hdf5_read(file, "/spread", 1, &u->nz, u->spread));
    PM_TRY(pm_hdf5_read(file, "/unknown", 1, &u->nz, u->unknown));
    PM_TRY(pm_hdf5_read_number(file, "/", "inflation", &u->inflation));
    PM_TRY(pm_hdf5_read_number(file, "/", "scale", &u->scale));
    return pm_hdf5_read_number(file, "/", "samples_per_residual", &u->samples_per_residual);
}

pm_status pm_uncertainty_load(pm_uncertainty *u, const char *folder, pm_system *system,
                              const pm_observation *o, bool *found) {
    char path[4096];
    pm_hdf5 *file = NULL;
    pm_status status;
    *u = (pm_uncertainty){.ny = o->count, .nz = system->scene->nz};
    snprintf(path, sizeof path, "%s/" FILE_NAME, folder);
    *found = access(path, R_OK) == 0;
    if (!*found) {
        return PM_OK;
    }
    pm_training_share(system);
    for (int i = 0; i < pm_system_components(system); ++i) {
        u->nweight += (int)pm_params_trained(pm_system_params(system, i));
    }
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_OWN, PM_EWEIGHTS));
    status = read_content(u, file);
done:
    pm_hdf5_close(file);
    if (status != PM_OK) {
        pm_uncertainty_free(u);
    }
    return status;
}

// --- words ---

static const char *component_name(const pm_system *system, int i) {
    const pm_scene *scene = system->scene;
    return i < scene->nsubsystem ? scene->subsystem[i].name
                                 : scene->port[i - scene->nsubsystem].name;
}

// Prints the constants of one component and counts its other weights that only the prior fixes.
static void print_component(const pm_uncertainty *u, const pm_shooting *s, int id, size_t *at) {
    const pm_params *params = pm_system_params(s->how.system, id);
    const char *name = component_name(s->how.system, id);
    int loose = 0, all = 0;
    for (int k = 0; k < params->count; ++k) {
        const pm_param_entry *entry = &params->entry[k];
        const bool constant = strncmp(entry->name, "constant.", 9) == 0;
        for (int j = 0; entry->trained && j < entry->rows * entry->cols; ++j, ++*at) {
            const double deviation = sqrt(u->covariance[*at * ((size_t)u->nweight + 1)]);
            const double reach = s->reach[*at], value = entry->value[j];
            const bool prior = reach > 0 && deviation > PRIOR_ALONE * reach;
            const bool logarithm = reach == PM_SHOOTING_REACH; // a positive constant
            if (!constant) {
                loose += prior;
                ++all;
            } else if (prior) {
                printf("  %s.%s: the data do not fix it (%.3g)\n", name, entry->name + 9,
                       logarithm ? exp(value) : value);
            } else if (logarithm) {
                printf("  %s.%s = %.5g, standard deviation %.2g %%\n", name, entry->name + 9,
                       exp(value), 100 * deviation);
            } else {
                printf("  %s.%s = %.5g, standard deviation %.2g\n", name, entry->name + 9, value,
                       deviation);
            }
        }
    }
    if (loose > 0) {
        printf("  %s: %d of %d weights of its networks follow from the prior alone\n", name, loose,
               all);
    }
}

void pm_uncertainty_print(const pm_uncertainty *u, const pm_shooting *s) {
    size_t at = 0;
    printf("What the measurements fix (variances are %.3g times those of independent noise; %.3g "
           "samples in a row count as one):\n",
           u->inflation, u->samples_per_residual);
    if (u->scale != 1) {
        printf("  bands: the variance that the weights cause counts %.3g times, as predictions of "
               "trajectories that were left out show\n",
               u->scale);
    }
    for (int c = 0; c < s->ny; ++c) {
        printf("  %s: residual %.3g\n", s->observation->name[c], u->noise[c]);
    }
    for (int i = 0; i < pm_system_components(s->how.system); ++i) {
        print_component(u, s, i, &at);
    }
    for (int c = 0; c < s->nz; ++c) {
        if (u->unknown[c] > PRIOR_ALONE) {
            printf("  %s: the data do not fix its start; it follows from the guess in the scene\n",
                   s->observation->component_name[c]);
        }
    }
    fflush(stdout);
}
