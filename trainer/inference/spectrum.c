// Computes the eigenvalues of the Gauss-Newton matrix, scaled to a unit diagonal, and attributes
// the flat directions to blocks of weights.
#include "inference/spectrum.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "data/trained.h"
#include "model/network.h"
#include "optimise/normal_equations.h"

#define MOST_WEIGHTS 1500   // beyond which the matrix is not computed
#define MOST_RESIDUALS 300  // of a sample, likewise
#define MOST_DECOMPOSED 500 // beyond which eigenvectors are not computed
#define SAMPLES 512
// Directions with eigenvalues below this are flat; the mean eigenvalue is 1.
#define FLAT 1e-10
#define MOST_NAMED 4
#define WARMER 0.01     // relative
#define NEGLIGIBLE 1e-5 // part of an effect of which rounding decides
#define ROUNDED 3       // times this part counts as nothing
#define MATCHED 0.1     // part of an effect below which other weights make up for most of it
#define UNCERTAIN 0.05  // relative error of temperatures, beyond which they are hardly determined
#define MOST_MATCHING 3 // blocks of weights that are named
#define LEARNED 1e-2    // squared residual, above which a model says nothing about the data
#define MOST_COUPLED 48 // weights of a coupling that is examined

// A block of weights, and the number of flat directions that it accounts for.
typedef struct block {
    const char *component, *name;
    int first, size;
    double share;
} block;

static int compare(const void *a, const void *b) {
    const block *x = a, *y = b;
    return (x->share < y->share) - (x->share > y->share);
}

static void report_flat(int n, double *h, int nblock, block *list, double *value, double *vector,
                        FILE *out) {
    if (!pm_eigen_largest(n, h, n, value, vector)) {
        return; // a report must not fail a fit
    }
    int flat = 0;
    for (int k = 0; k < n; ++k) {
        if (value[k] > FLAT) {
            continue;
        }
        ++flat;
        for (int b = 0; b < nblock; ++b) {
            for (int i = 0; i < list[b].size; ++i) {
                const double part = vector[(ptrdiff_t)k * n + list[b].first + i];
                list[b].share += part * part;
            }
        }
    }
    qsort(list, (size_t)nblock, sizeof *list, compare);
    fprintf(out, "flat directions: %d of %d%s", flat, n, flat > 0 ? ", most in" : "");
    for (int b = 0; b < nblock && b < MOST_NAMED && list[b].share > 0.5; ++b) {
        fprintf(out, "%s %s %s (%.0f)", b == 0 ? "" : ",", list[b].component, list[b].name,
                list[b].share);
    }
    fputc('\n', out);
}

// Says which ports have a learned reversible coupling without which the residuals would not be
// larger, once all other weights have made up for it as far as they can. `square` is the mean
// square of the residuals, `size` [n] the change of the residuals by each weight, h [n][n] the
// matrix, scaled to a unit diagonal, which is overwritten, as `column` [n][MOST_COUPLED] is.
static void report_needless(pm_objective *objective, double square, const double *size, int nblock,
                            const pm_trained *trained, double *h, double *column, FILE *out) {
    const pm_system *system = pm_objective_context(objective).system;
    const ptrdiff_t n = pm_objective_size(objective);
    for (ptrdiff_t i = 0; i < n; ++i) {
        h[i * (n + 1)] += NEGLIGIBLE * NEGLIGIBLE;
    }
    if (!pm_cholesky_factor((int)n, h)) {
        return;
    }
    for (int port = system->scene->physics.nsubsystem; port < pm_system_components(system);
         ++port) {
        int index[MOST_COUPLED];
        double step[MOST_COUPLED], inverse[MOST_COUPLED * MOST_COUPLED], sum = 0;
        int m = 0;
        for (int b = 0; b < nblock; ++b) {
            // The coupling is linear in these weights, so that it vanishes with them.
            const char *name = trained[b].entry->name;
            const bool linear =
                strncmp(name, "reversible.matrix.", 18) == 0 && strstr(name, ".layer") == NULL;
            for (int k = 0; linear && trained[b].component == port && k < trained[b].size; ++k) {
                if (m < MOST_COUPLED) {
                    index[m] = trained[b].first + k;
                    step[m] = trained[b].entry->value[k] * size[index[m]];
                }
                ++m;
            }
        }
        if (m == 0 || m > MOST_COUPLED) {
            continue;
        }
        // The block of the inverse matrix that belongs to these weights: its inverse is the matrix
        // of them alone, after elimination of all others.
        memset(column, 0, (size_t)(n * m) * sizeof *column);
        for (int k = 0; k < m; ++k) {
            column[(ptrdiff_t)index[k] * m + k] = 1;
        }
        pm_cholesky_back((int)n, h, m, column);
        double rest[MOST_COUPLED];
        for (int k = 0; k < m; ++k) {
            rest[k] = step[k];
            memcpy(inverse + (ptrdiff_t)k * m, column + (ptrdiff_t)index[k] * m,
                   (size_t)m * sizeof *column);
        }
        if (!pm_cholesky_solve(m, inverse, rest)) {
            continue;
        }
        for (int k = 0; k < m; ++k) {
            sum += rest[k] * step[k];
        }
        if (sum >= 0 && sum < square && square < LEARNED) {
            fprintf(out,
                    "%s: the data do not need its learned reversible coupling: without it the "
                    "residuals would change by %.1e, and they are %.1e\n",
                    pm_trained_name(system, port), sqrt(sum), sqrt(square));
        }
    }
}

// Says whether other weights can make up for a change of all temperatures. `effect` is the change
// of the residuals by the weight `warmth`. h [n][n] is the matrix, scaled to a unit diagonal, and
// is overwritten, as value [n] is.
static void report_temperatures(pm_objective *objective, double median, double effect, int warmth,
                                int nblock, block *list, double *h, double *value, FILE *out) {
    const int n = pm_objective_size(objective);
    memset(value, 0, (size_t)n * sizeof *value);
    for (ptrdiff_t i = 0; i < n; ++i) {
        h[i * (n + 1)] += NEGLIGIBLE * NEGLIGIBLE;
    }
    value[warmth] = 1;
    if (!pm_cholesky_solve(n, h, value) || !(value[warmth] > 0)) {
        return;
    }
    // The part of the effect that is left if all other weights change so as to make up for it, as
    // far as they can: 1/sqrt(H_aa (H^-1)_aa). It counts as nothing where rounding decides.
    // Temperatures are determined as far as the rest stands out from the residuals of the model.
    const double part = 1 / sqrt(value[warmth]);
    const double known = part > ROUNDED * NEGLIGIBLE ? part * effect : 0;
    if (part > MATCHED || !(sqrt(median) > UNCERTAIN * known)) {
        return;
    }
    for (int b = 0; b < nblock; ++b) { // how much each block moves to make up for it
        list[b].share = 0;
        for (int i = list[b].first; i < list[b].first + list[b].size; ++i) {
            list[b].share += i == warmth ? 0 : value[i] * value[i];
        }
    }
    qsort(list, (size_t)nblock, sizeof *list, compare);
    fprintf(out,
            "temperatures are hardly determined: other weights can make up for all but %.2g %% "
            "of this change, which is less than the residuals show. What is known of them "
            "settles it:",
            100 * part);
    for (int b = 0; b < nblock && b < MOST_MATCHING && list[b].share > 0; ++b) {
        fprintf(out, "%s %s %s", b == 0 ? "" : ",", list[b].component, list[b].name);
        list[b].share = 0;
    }
    fprintf(
        out,
        "\nThe scale of energies and powers is then not fixed either. It follows the temperature "
        "with which training starts: 300 K, or `temperature:` in the item of a model's energy "
        "that has the entropy.\n");
    for (int b = 0; b < nblock; ++b) {
        list[b].share = 0;
    }
}

static void report_unexamined(int n, FILE *out) {
    fprintf(out, "flat directions: not examined, since %d weights are more than %d\n", n,
            MOST_DECOMPOSED);
}

static pm_status report(pm_objective *objective, pm_gauss_newton *normal, pm_arena *arena,
                        FILE *out) {
    const int n = pm_objective_size(objective), all = pm_objective_samples(objective);
    const pm_system *system = pm_objective_context(objective).system;
    const int nblock = pm_trained_list(system, NULL);
    const size_t size = (size_t)n, square = n <= MOST_DECOMPOSED ? size * size : 0;
    pm_trained *trained = pm_arena_array(arena, (size_t)nblock + 1, sizeof *trained);
    block *list = pm_arena_array(arena, (size_t)nblock + 1, sizeof *list);
    double *hessian = pm_arena_array(arena, size * size, sizeof *hessian);
    double *gradient = pm_arena_array(arena, size, sizeof *gradient);
    double *value = pm_arena_array(arena, size, sizeof *value);
    double *vector = pm_arena_array(arena, square + 1, sizeof *vector);
    PM_TRY(pm_arena_status(arena, "a spectrum"));
    pm_trained_list(system, trained);
    int warmth = -1; // the weight by which all temperatures rise; -1: no temperature is learned
    bool thermal = false;
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        const pm_potential_spec *energy = &system->part[i]->spec.energy;
        for (int k = 0; k < energy->nterm; ++k) {
            thermal = thermal || energy->term[k].nthermal > 0;
        }
    }
    for (int b = 0; b < nblock; ++b) {
        list[b] = (block){.component = pm_trained_name(system, trained[b].component),
                          .name = trained[b].entry->name,
                          .first = trained[b].first,
                          .size = trained[b].size};
        if (warmth < 0 && thermal && strcmp(list[b].name, PM_WARMTH) == 0) {
            warmth = list[b].first;
        }
    }
    int index[SAMPLES], count = 0;
    for (; count < SAMPLES && count < all; ++count) {
        index[count] = (int)((long)count * all / (all < SAMPLES ? all : SAMPLES));
    }
    pm_gauss_newton_evaluate(normal, count, index, gradient, hessian);
    // The matrix is scaled to a unit diagonal. Rows of weights without any effect become 0.
    for (int i = 0; i < n; ++i) {
        gradient[i] = sqrt(fmax(hessian[(ptrdiff_t)i * n + i], 0));
    }
    for (int i = 0; i < n; ++i) {
        for (int j = i; j < n; ++j) {
            double *entry = &hessian[(ptrdiff_t)i * n + j];
            *entry = gradient[i] > 0 && gradient[j] > 0 ? *entry / (gradient[i] * gradient[j]) : 0;
            hessian[(ptrdiff_t)j * n + i] = *entry;
        }
    }
    if (warmth >= 0) {
        fprintf(out, "temperatures: all higher by 1 %% would change the residuals by %.1e\n",
                WARMER * gradient[warmth]);
    }
    double median = 0, mean = 0;
    PM_TRY(pm_objective_residuals(objective, &median, &mean));
    if (n <= MOST_DECOMPOSED) {
        memcpy(vector, hessian, square * sizeof *vector);
        double *column = pm_arena_array(arena, size * MOST_COUPLED, sizeof *column);
        PM_TRY(pm_arena_status(arena, "a spectrum"));
        report_needless(objective, mean, gradient, nblock, trained, vector, column, out);
    }
    if (warmth >= 0 && n <= MOST_DECOMPOSED) {
        memcpy(vector, hessian, square * sizeof *vector);
        report_temperatures(objective, median, gradient[warmth], warmth, nblock, list, vector,
                            value, out);
    }
    if (n <= MOST_DECOMPOSED) {
        report_flat(n, hessian, nblock, list, value, vector, out);
    } else {
        report_unexamined(n, out);
    }
    fflush(out);
    return PM_OK;
}

pm_status pm_spectrum_report(pm_objective *objective, FILE *out) {
    const int n = pm_objective_size(objective);
    pm_gauss_newton *normal = NULL;
    pm_arena arena = {0};
    if (n > MOST_WEIGHTS) {
        report_unexamined(n, out);
    }
    if (n == 0 || n > MOST_WEIGHTS || pm_objective_residual_count(objective) > MOST_RESIDUALS) {
        return PM_OK;
    }
    PM_TRY(pm_gauss_newton_open(&normal, objective, true, NULL));
    const pm_status status = report(objective, normal, &arena, out);
    pm_gauss_newton_close(normal);
    pm_arena_free(&arena);
    return status;
}
