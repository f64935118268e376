// The covariance of the weights, its file, and what it says in the names of the scene.
#include "inference/uncertainty.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/linalg.h"
#include "data/trained.h"
#include "graph/program.h"
#include "model/constants.h"
#include "store/hdf5_io.h"

#define FILE_NAME "measured.h5"
// Lags of the autocorrelation, until it falls below a limit.
#define MOST_LAGS 400
#define LEAST_CORRELATION 0.05
// A number of samples that is so near to 1 is printed as 1.
#define EACH 5e-3
// A start, or a weight, keeps at least this part of the deviation of its prior if the data tell
// nothing about it.
#define PRIOR_ALONE 0.5
// Fewer trajectories than this do not show by themselves how much trajectories disagree.
#define FEWEST_COMPARED 5
// Of a normal distribution: the standard deviation divided by the median absolute value.
#define NORMAL_MEDIAN 1.4826022185056018
// Standard error of the logarithm of the median difference of n + 1 independent samples, times the
// root of n.
#define MEDIAN_ERROR 1.25
#define SHARED 2.0 // such errors by which neighbouring residuals agree, if they do

#define MOST_DIRECTIONS 500 // beyond which eigenvectors take too long
#define MOST_PRINTED 6      // directions
#define MOST_FACTOR 1000.0  // a larger one of a constant is not printed as a number
#define UNFIXED 0.25        // standard deviation along a direction that the data do not fix
#define SINGLE 0.95         // part of the square of a direction that makes it one constant
#define NAMED 0.15          // of the largest change, at least, of the constants that are named
#define NEAR_ZERO -0.5      // change of a logarithm, along its tangent
#define COLLINEAR 20        // collinearity index of constants that are hard to tell apart

// --- autocorrelation ---

static double samples_per_residual(const pm_shooting *s) {
    double sum = 1;
    for (int lag = 1; lag <= MOST_LAGS; ++lag) {
        // The mean product of residuals that are `lag` samples apart, in units of the noise.
        double product = 0, square = 0;
        for (int i = 0; i < s->tracks->count; ++i) {
            const pm_track *t = &s->tracks->track[i];
            for (int k = 0; k + lag < t->count; ++k) {
                for (int c = 0; c < s->ny; ++c) {
                    const ptrdiff_t at = (ptrdiff_t)k * s->ny + c;
                    const ptrdiff_t later = at + (ptrdiff_t)lag * s->ny;
                    if (isfinite(t->y[at]) && isfinite(t->y[later])) {
                        const double a = s->residual[i][at] / s->terms.noise[c];
                        const double b = s->residual[i][later] / s->terms.noise[c];
                        product += a * b;
                        square += 0.5 * (a * a + b * b);
                    }
                }
            }
        }
        const double r = square > 0 ? product / square : 0;
        if (r < LEAST_CORRELATION) {
            break;
        }
        sum += 2 * r;
    }
    return sum;
}

// --- independent noise ---

// --- disagreement of trajectories ---

// Compares the gradients g of single trajectories with their covariance: the mean of g' H^-1 g over
// all directions that the data fix is 1 if trajectories differ by independent noise alone.
// `inverse` is H^-1 [nweight][nweight]. `gradient` [nwindow][nweight] is zero. 0: not known.
static double disagreement(pm_shooting *s, const double *inverse, double *gradient) {
    const ptrdiff_t n = s->nweight;
    double sum = 0, fixed = 0;
    // Where every track is one window, its part of the equations can be evaluated alone.
    bool known = s->nwindow > 1;
    for (int w = 0; w < s->nwindow; ++w) {
        known = known && !s->window[w].follows && s->window[w].ends;
    }
    if (known) {
        s->blocks.window_gradient = gradient;
        pm_shooting_evaluate(s, s->z, true);
        s->blocks.window_gradient = NULL;
        known = s->failed == PM_OK;
    }
    for (ptrdiff_t w = 0; w < s->nwindow && known; ++w) {
        // Window w is a whole track. Eliminate its unknown start from its gradient.
        const ptrdiff_t nz = s->nz, nb = s->nborder;
        double *own = s->blocks.own + w * nz * nz, *border = s->blocks.border + w * nz * nb;
        known = pm_cholesky_factor(s->nz, own);
        if (known) {
            double *start = s->blocks.factor; // own^-1 times the gradient by the start
            for (ptrdiff_t i = 0; i < nz; ++i) {
                start[i] = border[i * nb + n];
            }
            pm_cholesky_back(s->nz, own, 1, start);
            for (ptrdiff_t i = 0; i < nz; ++i) {
                for (ptrdiff_t k = 0; k < n; ++k) {
                    gradient[w * n + k] -= border[i * nb + k] * start[i];
                }
            }
        }
    }
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
        const double reach = s->terms.reach[k];
        fixed += reach > 0 ? fmax(1 - inverse[k * (n + 1)] / (reach * reach), 0) : 1;
    }
    return known && fixed > 0.5 ? sum / fixed * s->nwindow / (s->nwindow - 1) : 0;
}

// --- making ---

static pm_status allocate(pm_uncertainty *u) {
    const size_t n = (size_t)u->nweight, nz = (size_t)u->nz;
    u->covariance = pm_arena_array(&u->arena, n * n + 1, sizeof *u->covariance);
    u->weights = pm_arena_array(&u->arena, n + 1, sizeof *u->weights);
    u->noise = pm_arena_array(&u->arena, (size_t)u->ny, sizeof *u->noise);
    u->independent = pm_arena_array(&u->arena, (size_t)u->ny, sizeof *u->independent);
    u->start = pm_arena_array(&u->arena, nz, sizeof *u->start);
    u->spread = pm_arena_array(&u->arena, nz, sizeof *u->spread);
    u->unknown = pm_arena_array(&u->arena, nz, sizeof *u->unknown);
    return pm_arena_status(&u->arena, "uncertainties");
}

static pm_status make(pm_uncertainty *u, pm_shooting *s, pm_arena *scratch) {
    const size_t n = (size_t)s->nweight, windows = (size_t)s->nwindow, nz = (size_t)s->nz;
    size_t samples = 1;
    for (int i = 0; i < s->tracks->count; ++i) {
        samples += (size_t)s->tracks->track[i].count;
    }
    double *step = pm_arena_array(scratch, n + windows * nz, sizeof *step);
    double *size = pm_arena_array(scratch, samples, sizeof *size);
    double *work = pm_arena_array(scratch, nz, sizeof *work);
    double *gradient = pm_arena_array(scratch, windows * n + 1, sizeof *gradient);
    PM_TRY(allocate(u));
    PM_TRY(pm_arena_status(scratch, "uncertainties"));
    pm_shooting_evaluate(s, s->z, true);
    const bool solved = s->failed == PM_OK && pm_shooting_solve(s, 0, step, step + n);
    if (!solved) {
        PM_TRY(s->failed);
        return pm_fail(PM_ENUMERIC, "the measurements and the priors do not fix all weights");
    }
    u->samples_per_residual = samples_per_residual(s);
    // The inverse of the Cholesky factor that the solution left.
    for (size_t i = 0; i < n; ++i) {
        u->covariance[i * (n + 1)] = 1;
    }
    if (n > 0) {
        pm_cholesky_back(s->nweight, s->blocks.reduced, s->nweight, u->covariance);
    }
    pm_shooting_weights(s, u->weights);
    memcpy(u->noise, s->terms.noise, (size_t)u->ny * sizeof *u->noise);
    for (int c = 0; c < u->ny; ++c) {
        double error;
        const double own = pm_uncertainty_independent(s, c, size, &error);
        const bool shares = own < u->noise[c] * exp(-SHARED * error);
        u->independent[c] = shares ? own : u->noise[c];
    }
    // Mean and spread of the first starts, and how much of their priors they keep.
    for (int c = 0; c < s->nz; ++c) {
        double mean = 0, square = 0, variance = 0;
        int count = 0;
        for (int w = 0; w < s->nwindow; ++w) {
            if (!s->window[w].follows) {
                const double z = s->z[(ptrdiff_t)w * s->nz + c];
                mean += z;
                square += z * z;
                // The variance of the start at fixed weights and later starts. It is exact where
                // the track is one window.
                memset(work, 0, (size_t)s->nz * sizeof *work);
                work[c] = 1;
                pm_cholesky_back(s->nz, s->blocks.factor + (ptrdiff_t)w * s->nz * s->nz, 1, work);
                variance += work[c];
                ++count;
            }
        }
        mean /= count;
        u->start[c] = mean;
        // A new start is further away: these few do not tell the mean, and noise hides each of
        // them.
        u->spread[c] =
            count > 1 ? sqrt(fmax(square / count - mean * mean, 0) * (count + 1) / (count - 1) +
                             variance / count)
                      : INFINITY;
        u->unknown[c] = s->terms.prior[c] > 0 ? sqrt(variance / count) / s->terms.prior[c] : 0;
    }
    const double ratio = disagreement(s, u->covariance, gradient);
    const bool compared = ratio > 0 && s->nwindow >= FEWEST_COMPARED;
    u->inflation = fmax(compared ? 1 : u->samples_per_residual, ratio);
    for (size_t i = 0; i < n * n; ++i) {
        u->covariance[i] *= u->inflation;
    }
    return PM_OK;
}

double pm_uncertainty_independent(const pm_shooting *s, int column, double *size, double *error) {
    size_t count = 0;
    for (int i = 0; i < s->tracks->count; ++i) {
        const pm_track *t = &s->tracks->track[i];
        for (int k = 0; k + 1 < t->count; ++k) {
            const ptrdiff_t at = (ptrdiff_t)k * s->ny + column, next = at + s->ny;
            const double change = fabs(s->residual[i][next] - s->residual[i][at]);
            if (isfinite(t->y[at]) && isfinite(t->y[next]) && isfinite(change)) {
                size[count++] = change; // that of a track which cannot be followed is none
            }
        }
    }
    pm_sort(count, size);
    *error = count > 0 ? MEDIAN_ERROR / sqrt((double)count) : INFINITY;
    return count > 0 ? NORMAL_MEDIAN / sqrt(2) * size[count / 2] : NAN;
}

pm_status pm_uncertainty_make(pm_uncertainty *u, pm_shooting *s) {
    *u = (pm_uncertainty){.nweight = s->nweight, .ny = s->ny, .nz = s->nz, .scale = 1};
    pm_arena scratch = {0};
    const pm_status status = make(u, s, &scratch);
    pm_arena_free(&scratch);
    if (status != PM_OK) {
        pm_uncertainty_free(u);
    }
    return status;
}

void pm_uncertainty_free(pm_uncertainty *u) {
    pm_arena_free(&u->arena);
    *u = (pm_uncertainty){0};
}

// --- how well energies are known ---

#define OF_DEVIATION 1e-3 // by which a weight moves for a difference quotient

// The energy of a subsystem, with the lowest and the highest of the fitted states.
typedef struct energy_range {
    pm_program *program;
    double *z;
    const double *value;
    const double *low, *high; // [nz]
    size_t nz;
} energy_range;

static double energy_at(const energy_range *e, const double *z) {
    memcpy(e->z, z, e->nz * sizeof *z);
    pm_program_run(e->program, 1);
    return *e->value;
}

static void find_range(energy_range *e, const pm_shooting *s, int first) {
    double lowest = INFINITY, highest = -INFINITY;
    for (int i = 0; i < s->tracks->count; i += s->stride) {
        for (int k = 0; k < s->tracks->track[i].count; ++k) {
            const double *z = s->state[i] + (ptrdiff_t)k * s->nz + first;
            const double energy = energy_at(e, z);
            e->low = energy < lowest ? z : e->low;
            e->high = energy > highest ? z : e->high;
            lowest = fmin(lowest, energy);
            highest = fmax(highest, energy);
        }
    }
}

pm_status pm_uncertainty_energies(const pm_uncertainty *u, const pm_shooting *s, double *share) {
    pm_system *system = s->how.system;
    const size_t n = (size_t)u->nweight;
    pm_arena scratch = {0};
    pm_status status;
    double *theta = pm_arena_array(&scratch, n + 1, sizeof *theta);
    double *slope = pm_arena_array(&scratch, n + 1, sizeof *slope);
    PM_TRY_DONE(pm_arena_status(&scratch, "the uncertainty of energies"));
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        const pm_part *part = system->part[i];
        pm_graph *g = NULL;
        energy_range e = {.nz = (size_t)part->layout.nz};
        share[i] = NAN;
        PM_TRY_DONE(pm_graph_open(&g));
        const pm_node z = pm_input(g, true, 1, part->layout.nz);
        const pm_node energy = pm_part_has_energy(part) ? pm_part_energy(g, part, z) : PM_NO_NODE;
        if (energy != PM_NO_NODE) {
            const pm_node own = pm_broadcast_to(g, energy, (pm_shape){true, 1, 1});
            status = pm_program_open(&e.program, g, 1, &own, 1);
            e.z = status == PM_OK ? pm_program_input(e.program, z) : NULL;
            e.value = status == PM_OK ? pm_program_value(e.program, own) : NULL;
        }
        if (e.z != NULL) {
            find_range(&e, s, system->scene->physics.subsystem[i].first);
        }
        if (e.low != NULL && e.high != NULL) {
            const double all = energy_at(&e, e.high) - energy_at(&e, e.low);
            double variance = 0;
            for (size_t k = 0; k < n; ++k) {
                const double step = OF_DEVIATION * sqrt(u->covariance[k * (n + 1)]);
                double end[2] = {0};
                for (int side = 0; side < 2 && step > 0; ++side) {
                    memcpy(theta, u->weights, n * sizeof *theta);
                    theta[k] += side == 0 ? -step : step;
                    pm_trained_scatter(system, theta);
                    end[side] = energy_at(&e, e.high) - energy_at(&e, e.low);
                }
                slope[k] = step > 0 ? (end[1] - end[0]) / (2 * step) : 0;
            }
            pm_trained_scatter(system, u->weights);
            for (size_t k = 0; k < n * n; ++k) {
                variance += slope[k / n] * u->covariance[k] * slope[k % n];
            }
            share[i] = all > 0 ? sqrt(fmax(variance, 0)) / all : NAN;
        }
        pm_program_close(e.program);
        pm_graph_close(g);
        PM_TRY_DONE(status);
    }
done:
    pm_arena_free(&scratch);
    return status;
}

// --- what may as well be zero ---

// Moves the variables of a quadratic model, whose minimum is at `away` [n] and whose inverse matrix
// of second derivatives is `inverse` [n][n], to where variable k is 0. Returns by how much the
// model rises. Other variables may have no variance any more, since they follow from k.
static double leave(size_t n, double *inverse, double *away, size_t k) {
    const double variance = inverse[k * (n + 1)], moves = away[k];
    if (!(variance > 0)) {
        return 0;
    }
    for (size_t i = 0; i < n; ++i) {
        if (i != k) {
            const double share = inverse[i * n + k] / variance;
            away[i] -= share * moves;
            for (size_t j = 0; j < n; ++j) {
                inverse[i * n + j] -= share * inverse[k * n + j];
            }
        }
    }
    for (size_t i = 0; i < n; ++i) {
        inverse[k * n + i] = inverse[i * n + k] = 0;
    }
    away[k] = 0;
    return moves * moves / (2 * variance);
}

// Leaves out weight k, which is `to_zero` away from zero, and the weights that mean nothing without
// it, which `own` tells (pm_uncertainty_spare) and which stay where they are.
static void leave_group(size_t n, double *inverse, double *away, const unsigned char *own,
                        const bool *gone, size_t k, double to_zero) {
    for (size_t i = 0; i < n; ++i) {
        if (!gone[i] && own[i] != PM_WEIGHT_NEEDED) {
            away[i] += i == k ? to_zero : 0;
            (void)leave(n, inverse, away, i);
        }
    }
}

pm_status pm_uncertainty_spare(pm_shooting *s, const unsigned char *optional, int *spare) {
    pm_arena scratch = {0};
    pm_status status = PM_OK;
    const size_t n = (size_t)s->nweight, nz = (size_t)s->nz * (size_t)s->nwindow;
    double *step = pm_arena_array(&scratch, n + nz, sizeof *step);
    double *inverse = pm_arena_array(&scratch, n * n + 1, sizeof *inverse);
    double *weight = pm_arena_array(&scratch, n + 1, sizeof *weight);
    double *first = pm_arena_array(&scratch, n + 1, sizeof *first);
    double *next = pm_arena_array(&scratch, n * n + 1, sizeof *next); // without one more group
    double *moved = pm_arena_array(&scratch, n + 1, sizeof *moved);   // likewise
    bool *needed = pm_arena_array(&scratch, n + 1, sizeof *needed);   // numbers, by all others
    bool *kept = pm_arena_array(&scratch, n + 1, sizeof *kept);
    double *block = pm_arena_array(&scratch, n * n + 1, sizeof *block); // of a group
    double *away = pm_arena_array(&scratch, n + 1, sizeof *away);       // likewise
    size_t *member = pm_arena_array(&scratch, n + 1, sizeof *member);   // likewise
    bool *gone = pm_arena_array(&scratch, n + 1, sizeof *gone);
    double count = 1;
    PM_TRY_DONE(pm_arena_status(&scratch, "what is spare"));
    memset(spare, 0, n * sizeof *spare);
    // The free starts of short windows would make up for much that is needed.
    bool whole = n > 0 && s->nwindow > 0;
    for (int w = 0; w < s->nwindow; ++w) {
        whole = whole && !s->window[w].follows && s->window[w].ends;
    }
    if (!whole) {
        goto done;
    }
    pm_shooting_evaluate(s, s->z, true);
    PM_TRY_DONE(s->failed);
    if (!pm_shooting_solve(s, 0, step, step + n)) {
        goto done;
    }
    for (size_t i = 0; i < n; ++i) {
        inverse[i * (n + 1)] = 1;
    }
    pm_cholesky_back(s->nweight, s->blocks.reduced, s->nweight, inverse);
    pm_shooting_weights(s, weight);
    for (int i = 0; i < s->tracks->count; i += s->stride) {
        count += (double)s->tracks->track[i].count * s->ny;
    }
    const double each = log(count) / 2;
    memcpy(first, step, n * sizeof *first);
    for (size_t i = 0; i < n; ++i) {
        needed[i] = optional[i * (n + 1)] == PM_LOGARITHM_NEEDED;
        for (size_t k = 0; k < n; ++k) {
            needed[i] = needed[i] && (k == i || optional[k * n + i] == PM_WEIGHT_NEEDED);
        }
    }
    for (int number = 0;;) {
        size_t least = n;
        double gain = 0;
        for (size_t k = 0; k < n; ++k) {
            const unsigned char *own = &optional[k * n];
            size_t m = 0;
            // A weight without variance follows from others that are zero already.
            if (own[k] == PM_WEIGHT_NEEDED || own[k] == PM_LOGARITHM_NEEDED || gone[k] || kept[k] ||
                !(inverse[k * (n + 1)] > 0)) {
                continue;
            }
            for (size_t i = 0; i < n; ++i) {
                if (!gone[i] && own[i] != PM_WEIGHT_NEEDED && i != k) {
                    member[m++] = i;
                }
            }
            member[m++] = k;
            for (size_t i = 0; i < m; ++i) {
                away[i] = step[member[i]];
                for (size_t j = 0; j < m; ++j) {
                    block[i * m + j] = inverse[member[i] * n + member[j]];
                }
            }
            double rise = 0;
            for (size_t i = 0; i + 1 < m; ++i) {
                rise += leave(m, block, away, i);
            }
            // How far it is from zero where the model has its minimum: logarithms along their
            // tangent, and no further than to zero.
            const bool logarithm = own[k] == PM_LOGARITHM_OPTIONAL;
            away[m - 1] += logarithm ? 1 : weight[k];
            rise += logarithm && away[m - 1] < 0 ? 0 : leave(m, block, away, m - 1);
            if ((double)m * each - rise > gain) {
                least = k;
                gain = (double)m * each - rise;
            }
        }
        if (least == n) {
            break;
        }
        const unsigned char *own = &optional[least * n];
        memcpy(next, inverse, n * n * sizeof *next);
        memcpy(moved, step, n * sizeof *moved);
        leave_group(n, next, moved, own, gone, least,
                    own[least] == PM_LOGARITHM_OPTIONAL ? 1 : weight[least]);
        for (size_t i = 0; i < n; ++i) {
            kept[least] |= needed[i] && moved[i] - first[i] < NEAR_ZERO;
        }
        if (kept[least]) {
            continue;
        }
        memcpy(inverse, next, n * n * sizeof *next);
        memcpy(step, moved, n * sizeof *moved);
        for (size_t i = 0; i < n; ++i) {
            number += !gone[i] && own[i] != PM_WEIGHT_NEEDED;
            gone[i] = gone[i] || own[i] != PM_WEIGHT_NEEDED;
        }
        spare[least] = number;
    }
done:
    pm_arena_free(&scratch);
    return status;
}

// --- the file ---

pm_status pm_uncertainty_save(const pm_uncertainty *u, const char *folder) {
    char path[4096];
    pm_hdf5 *file = NULL;
    pm_status status;
    snprintf(path, sizeof path, "%s/" FILE_NAME, folder);
    PM_TRY_DONE(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC));
    const int square[2] = {u->nweight, u->nweight};
    if (u->nweight > 0) {
        PM_TRY_DONE(pm_hdf5_write(file, "/covariance", 2, square, u->covariance));
        PM_TRY_DONE(pm_hdf5_write(file, "/weights", 1, square, u->weights));
    }
    PM_TRY_DONE(pm_hdf5_write(file, "/noise", 1, &u->ny, u->noise));
    PM_TRY_DONE(pm_hdf5_write(file, "/independent", 1, &u->ny, u->independent));
    PM_TRY_DONE(pm_hdf5_write(file, "/start", 1, &u->nz, u->start));
    PM_TRY_DONE(pm_hdf5_write(file, "/spread", 1, &u->nz, u->spread));
    PM_TRY_DONE(pm_hdf5_write(file, "/unknown", 1, &u->nz, u->unknown));
    PM_TRY_DONE(pm_hdf5_write_number(file, "/", "inflation", u->inflation));
    PM_TRY_DONE(pm_hdf5_write_number(file, "/", "scale", u->scale));
    PM_TRY_DONE(pm_hdf5_write_number(file, "/", "samples_per_residual", u->samples_per_residual));
    status = pm_hdf5_commit(file);
done:
    pm_hdf5_close(file);
    return status;
}

pm_status pm_uncertainty_load(pm_uncertainty *u, const char *folder, pm_system *system,
                              const pm_observation *o, bool *found) {
    char path[4096];
    pm_hdf5 *file = NULL;
    pm_status status;
    *u = (pm_uncertainty){.ny = o->count, .nz = system->scene->physics.nz};
    snprintf(path, sizeof path, "%s/" FILE_NAME, folder);
    *found = access(path, R_OK) == 0;
    if (!*found) {
        return PM_OK;
    }
    pm_trained_share(system);
    u->nweight = pm_trained_count(system);
    PM_TRY_DONE(pm_hdf5_open(&file, path, PM_HDF5_OWN, PM_EWEIGHTS));
    const int square[2] = {u->nweight, u->nweight};
    PM_TRY_DONE(allocate(u));
    if (u->nweight > 0) {
        PM_TRY_DONE(pm_hdf5_read(file, "/covariance", 2, square, u->covariance));
        PM_TRY_DONE(pm_hdf5_read(file, "/weights", 1, square, u->weights));
    }
    PM_TRY_DONE(pm_hdf5_read(file, "/noise", 1, &u->ny, u->noise));
    PM_TRY_DONE(pm_hdf5_read(file, "/independent", 1, &u->ny, u->independent));
    PM_TRY_DONE(pm_hdf5_read(file, "/start", 1, &u->nz, u->start));
    PM_TRY_DONE(pm_hdf5_read(file, "/spread", 1, &u->nz, u->spread));
    PM_TRY_DONE(pm_hdf5_read(file, "/unknown", 1, &u->nz, u->unknown));
    PM_TRY_DONE(pm_hdf5_read_number(file, "/", "inflation", &u->inflation));
    PM_TRY_DONE(pm_hdf5_read_number(file, "/", "scale", &u->scale));
    status = pm_hdf5_read_number(file, "/", "samples_per_residual", &u->samples_per_residual);
done:
    pm_hdf5_close(file);
    if (status != PM_OK) {
        pm_uncertainty_free(u);
    }
    return status;
}

// --- words ---

// Prints the constants of one component, those that only the prior fixes in one line, and counts
// its other weights that only the prior fixes.
static void print_component(const pm_uncertainty *u, const pm_shooting *s, int id, size_t *at) {
    const pm_params *params = pm_system_params(s->how.system, id);
    const char *name = pm_trained_name(s->how.system, id);
    char *unfixed = NULL;
    size_t size = 0;
    FILE *list = open_memstream(&unfixed, &size);
    int loose = 0, all = 0;
    for (int k = 0; k < params->count && list != NULL; ++k) {
        const pm_param_entry *entry = &params->entry[k];
        const char *constant = pm_constant_name(entry->name);
        for (int j = 0; entry->trained && j < entry->rows * entry->cols; ++j, ++*at) {
            const double deviation = sqrt(u->covariance[*at * ((size_t)u->nweight + 1)]);
            const double reach = s->terms.reach[*at], value = entry->value[j];
            const bool prior = reach > 0 && deviation > PRIOR_ALONE * reach;
            const bool logarithm = reach == PM_SHOOTING_REACH; // a positive constant
            if (constant == NULL) {
                loose += prior;
                ++all;
            } else if (prior) {
                fprintf(list, "%s %s (%.3g)", ftell(list) > 0 ? "," : "", constant,
                        logarithm ? exp(value) : value);
            } else if (logarithm) {
                printf("  %s.%s = %.5g, standard deviation %.2g %%\n", name, constant, exp(value),
                       100 * deviation);
            } else {
                printf("  %s.%s = %.5g, standard deviation %.2g\n", name, constant, value,
                       deviation);
            }
        }
    }
    if (list != NULL && fclose(list) == 0 && size > 0) {
        printf("  %s: the data do not fix%s\n", name, unfixed);
    }
    free(unfixed);
    if (loose > 0) {
        printf("  %s: %d of %d weights of its networks follow from the prior alone\n", name, loose,
               all);
    }
}

void pm_uncertainty_print(const pm_uncertainty *u, const pm_shooting *s) {
    size_t at = 0;
    const bool each = fabs(u->samples_per_residual - 1) < EACH;
    printf("What the measurements fix (variances are %.3g times those of independent noise; %.3g "
           "sample%s in a row count%s as one):\n",
           u->inflation, u->samples_per_residual, each ? "" : "s", each ? "s" : "");
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

// --- directions: the eigenvectors of the covariance of all weights, in the names of the scene ---

// A weight of the fit.
typedef struct weight {
    const char *component, *name; // name: NULL for a weight of a network
    const char *at;               // place of its model in the training file
    bool logarithm;
    double unit; // its change that counts as 1 in a direction
} weight;

// Work space for directions [nweight] of weights.
typedef struct directions {
    weight *list;
    double *matrix, *vector, *value; // [nweight][nweight], likewise, [nweight]
} directions;

static pm_status open_directions(directions *d, const pm_shooting *s, pm_arena *arena) {
    const pm_system *system = s->how.system;
    const size_t n = (size_t)s->nweight;
    const int count = pm_trained_list(system, NULL);
    pm_trained *trained = pm_arena_array(arena, (size_t)count, sizeof *trained);
    d->list = pm_arena_array(arena, n, sizeof *d->list);
    d->matrix = pm_arena_array(arena, n * n, sizeof *d->matrix);
    d->vector = pm_arena_array(arena, n * n, sizeof *d->vector);
    d->value = pm_arena_array(arena, n, sizeof *d->value);
    PM_TRY(pm_arena_status(arena, "directions of weights"));
    pm_trained_list(system, trained);
    for (int i = 0; i < count; ++i) {
        const char *name = trained[i].entry->name;
        const char *constant = pm_constant_name(name);
        for (int j = 0; j < trained[i].size; ++j) {
            const int at = trained[i].first + j;
            const double reach = s->terms.reach[at];
            const bool logarithm = constant != NULL && reach == PM_SHOOTING_REACH;
            const double size =
                fmax(fabs(trained[i].entry->value[j]), fabs(s->terms.first_weight[at]));
            d->list[at] = (weight){.component = pm_trained_name(system, trained[i].component),
                                   .name = constant,
                                   .at = pm_trained_place(system, trained[i].component),
                                   .logarithm = logarithm,
                                   .unit = constant == NULL ? reach
                                           : logarithm      ? 1
                                           : size > 0       ? size
                                                            : 1};
        }
    }
    return PM_OK;
}

pm_status pm_identifiability_print(const pm_uncertainty *u, const pm_shooting *s) {
    const size_t n = (size_t)u->nweight;
    if (n < 2 || n > MOST_DIRECTIONS) {
        return PM_OK;
    }
    directions d;
    pm_arena arena = {0};
    const pm_status status = open_directions(&d, s, &arena);
    for (size_t i = 0; status == PM_OK && i < n * n; ++i) {
        d.matrix[i] = u->covariance[i] / (d.list[i / n].unit * d.list[i % n].unit);
    }
    if (status == PM_OK && pm_eigen_largest((int)n, d.matrix, (int)n, d.value, d.vector)) {
        int printed = 0;
        for (size_t k = 0; k < n && d.value[k] > UNFIXED * UNFIXED; ++k) {
            const double *direction = d.vector + k * n;
            // Only directions that consist of several constants are printed.
            double constants = 0, largest = 0, sign = 1;
            for (size_t i = 0; i < n; ++i) {
                constants += d.list[i].name != NULL ? direction[i] * direction[i] : 0;
                if (fabs(direction[i]) > largest) {
                    largest = fabs(direction[i]);
                    sign = direction[i] > 0 ? 1 : -1;
                }
            }
            if (printed == MOST_PRINTED || !(constants > 0.5 && largest * largest < SINGLE)) {
                continue;
            }
            const char *before = "  cannot be identified, as the data hardly change along";
            for (size_t i = 0; i < n; ++i) {
                const double change = sign * direction[i] * sqrt(d.value[k]);
                if (fabs(direction[i]) < NAMED * largest || d.list[i].name == NULL) {
                    continue;
                }
                printf("%s %s.%s ", before, d.list[i].component, d.list[i].name);
                before = ",";
                if (d.list[i].logarithm && fabs(change) > log(MOST_FACTOR)) {
                    printf("x anything");
                } else if (d.list[i].logarithm) {
                    printf("x %.2g", exp(change));
                } else {
                    printf("%+.2g", change * d.list[i].unit);
                }
            }
            printf(" (one standard deviation): give one of them\n");
            ++printed;
        }
    }
    pm_arena_free(&arena);
    fflush(stdout);
    return status;
}

// --- before the fit ---

// Computes the normal matrix of the weights after elimination of all starts, as its Cholesky factor
// in s->blocks.reduced. Returns false if the equations are singular or there is no memory.
static bool factorise(pm_shooting *s, const double *noise, const double *gap) {
    const pm_shooting_terms kept = s->terms;
    pm_arena arena = {0};
    const size_t n = (size_t)s->nweight + (size_t)s->nwindow * (size_t)s->nz;
    double *step = pm_arena_array(&arena, n, sizeof *step);
    s->terms.noise = pm_arena_array(&arena, (size_t)s->ny, sizeof *noise);
    s->terms.gap = pm_arena_array(&arena, (size_t)s->nz, sizeof *gap);
    bool known = pm_arena_status(&arena, "directions of weights") == PM_OK;
    if (known) {
        memcpy(s->terms.noise, noise, (size_t)s->ny * sizeof *noise);
        memcpy(s->terms.gap, gap, (size_t)s->nz * sizeof *gap);
        s->terms.huber = INFINITY; // the model is still wrong: all samples count
        s->terms.hold = s->terms.everywhere = s->terms.early = false;
        pm_shooting_evaluate(s, s->z, true);
        known = s->failed == PM_OK && pm_shooting_solve(s, 0, step, step + s->nweight);
    }
    s->terms = kept;
    pm_arena_free(&arena);
    return known;
}

// Returns element i of the diagonal of u' u.
static double diagonal(size_t n, const double *u, size_t i) {
    double square = 0;
    for (size_t k = 0; k <= i; ++k) {
        square += u[k * n + i] * u[k * n + i];
    }
    return square;
}

pm_status pm_identifiability_warn(pm_shooting *s, const double *noise, const double *gap) {
    const size_t n = (size_t)s->nweight;
    if (n < 2 || n > MOST_DIRECTIONS) {
        return PM_OK;
    }
    directions d;
    pm_arena arena = {0};
    pm_status status = open_directions(&d, s, &arena);
    if (status == PM_OK && factorise(s, noise, gap)) {
        // The inverse of the matrix u' u after scaling its diagonal to 1.
        for (size_t i = 0; i < n; ++i) {
            d.matrix[i * (n + 1)] = sqrt(diagonal(n, s->blocks.reduced, i));
        }
        pm_cholesky_back((int)n, s->blocks.reduced, (int)n, d.matrix);
        for (size_t i = 0; i < n * n; ++i) {
            d.matrix[i] *= sqrt(diagonal(n, s->blocks.reduced, i / n));
        }
        const bool found = pm_eigen_largest((int)n, d.matrix, (int)n, d.value, d.vector);
        for (size_t k = 0; found && k < n && k < MOST_PRINTED; ++k) {
            // Names the constants of the direction, if it consists mostly of them.
            const double *direction = d.vector + k * n;
            size_t largest = 0;
            double constants = 0;
            for (size_t i = 0; i < n; ++i) {
                largest = fabs(direction[i]) > fabs(direction[largest]) ? i : largest;
                constants += d.list[i].name != NULL ? direction[i] * direction[i] : 0;
            }
            if (!(d.value[k] > COLLINEAR * COLLINEAR) || constants < 0.5 ||
                d.list[largest].name == NULL) {
                continue;
            }
            printf("%s: note:", d.list[largest].at);
            int count = 0;
            for (size_t i = 0; i < n; ++i) {
                if (d.list[i].name != NULL &&
                    fabs(direction[i]) > NAMED * fabs(direction[largest])) {
                    printf("%s %s.%s", count++ > 0 ? "," : "", d.list[i].component, d.list[i].name);
                }
            }
            printf(": the measurements hardly tell them apart from each other and from hidden "
                   "starts (collinearity %.0f); the fit may miss them: give what is known\n",
                   sqrt(d.value[k]));
        }
        fflush(stdout);
    }
    status = status == PM_OK ? s->failed : status;
    pm_arena_free(&arena);
    return status;
}
