// Computes the eigenvalues of the Gauss-Newton matrix, scaled to a unit diagonal, and attributes
// the flat directions to blocks of weights.
#include "learn/spectrum.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "learn/gauss_newton_matrix.h"
#include "learn/residuals.h"
#include "model/network.h"

#define MOST_WEIGHTS 1500   // beyond which the matrix is not computed
#define MOST_RESIDUALS 300  // of a sample, likewise
#define MOST_DECOMPOSED 500 // beyond which eigenvectors are not computed
#define SAMPLES 512
// Directions with eigenvalues below this are flat; the mean eigenvalue is 1.
#define FLAT 1e-10
#define MOST_NAMED 4
#define WARMER 0.01     // relative
#define NEGLIGIBLE 1e-5 // part of an effect of which rounding decides
#define MATCHED 1e-3    // part of an effect below which other weights make up for it

// A block of weights, and the number of flat directions that it accounts for.
typedef struct block {
    const char *component, *name;
    size_t first, size;
    double share;
} block;

static const char *component_name(const pm_system *system, int i) {
    const pm_scene *scene = system->scene;
    return i < scene->nsubsystem ? scene->subsystem[i].name
                                 : scene->port[i - scene->nsubsystem].name;
}

// Lists all blocks of trained weights in order and returns their number. `list` may be NULL.
static int list_blocks(const pm_system *system, block *list) {
    int count = 0;
    size_t at = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const size_t size = (size_t)entry->rows * (size_t)entry->cols;
            if (entry->trained && list != NULL) {
                list[count] = (block){component_name(system, i), entry->name, at, size, 0};
            }
            count += entry->trained;
            at += entry->trained ? size : 0;
        }
    }
    return count;
}

static int compare(const void *a, const void *b) {
    const block *x = a, *y = b;
    return (x->share < y->share) - (x->share > y->share);
}

// Returns the weight by which all temperatures rise; -1: no temperature is learned.
static int find_warmth(int nblock, const block *list) {
    int i = 0;
    while (i < nblock && strcmp(list[i].name, PM_WARMTH) != 0) {
        ++i;
    }
    return i < nblock ? (int)list[i].first : -1;
}

// Scales the matrix to a unit diagonal. Rows of weights without any effect become 0.
static void scale_matrix(int n, double *h, double *root) {
    for (int i = 0; i < n; ++i) {
        root[i] = sqrt(fmax(h[(ptrdiff_t)i * n + i], 0));
    }
    for (int i = 0; i < n; ++i) {
        for (int j = i; j < n; ++j) {
            double *entry = &h[(ptrdiff_t)i * n + j];
            *entry = root[i] > 0 && root[j] > 0 ? *entry / (root[i] * root[j]) : 0;
            h[(ptrdiff_t)j * n + i] = *entry;
        }
    }
}

// Returns which part of the effect of weight `at` remains if all other weights change so as to make
// up for it, as far as they can: 1/sqrt(H_aa (H^-1)_aa) for the matrix H, which is scaled to a unit
// diagonal. The part counts as NEGLIGIBLE where rounding decides.
static double unmatched_part(int n, const double *scaled, int at) {
    double *factor = malloc((size_t)n * (size_t)n * sizeof *factor);
    double *column = calloc((size_t)n, sizeof *column);
    double part = 1; // without memory nothing is said
    if (factor != NULL && column != NULL) {
        memcpy(factor, scaled, (size_t)n * (size_t)n * sizeof *factor);
        for (ptrdiff_t i = 0; i < n; ++i) {
            factor[i * (n + 1)] += NEGLIGIBLE * NEGLIGIBLE;
        }
        column[at] = 1;
        if (pm_cholesky_solve(n, factor, column) && column[at] > 0) {
            part = 1 / sqrt(column[at]);
        }
    }
    free(factor);
    free(column);
    return part;
}

// Prints by how much the residuals change if all temperatures rise by WARMER, and whether the data
// determine the temperatures.
static void report_warmth(int n, const double *scaled, int at, double effect, FILE *out) {
    fprintf(out, "temperatures: all higher by 1 %% would change the residuals by %.1e\n", effect);
    const double part = n <= MOST_DECOMPOSED ? unmatched_part(n, scaled, at) : 1;
    if (part < MATCHED) {
        fprintf(out,
                "temperatures are hardly determined: other weights can make up for all but %.2g %% "
                "of this change. Where no coefficient of L is given, the scale of all energies is "
                "free, and parts fit together by the learned couplings alone; give a coefficient "
                "that is known.\n",
                100 * part);
    }
}

static pm_status report_flat(int n, double *h, int nblock, block *list, FILE *out) {
    double *value = malloc((size_t)n * sizeof *value);
    double *vector = malloc((size_t)n * (size_t)n * sizeof *vector);
    pm_status status = PM_OK;
    if (value == NULL || vector == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a spectrum");
        goto done;
    }
    if (!pm_eigen_largest(n, h, n, value, vector)) {
        goto done; // a report must not fail a fit
    }
    int flat = 0;
    for (int k = 0; k < n; ++k) {
        if (value[k] > FLAT) {
            continue;
        }
        ++flat;
        for (int b = 0; b < nblock; ++b) {
            for (size_t i = 0; i < list[b].size; ++i) {
                const double part = vector[(size_t)k * (size_t)n + list[b].first + i];
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
done:
    free(value);
    free(vector);
    return status;
}

static void report_unexamined(int n, FILE *out) {
    fprintf(out, "flat directions: not examined, since %d weights are more than %d\n", n,
            MOST_DECOMPOSED);
}

static pm_status report(pm_objective *objective, pm_gauss_newton_matrix *normal, FILE *out) {
    const int n = pm_objective_size(objective), all = pm_objective_samples(objective);
    const pm_system *system = pm_objective_context(objective).system;
    const int nblock = list_blocks(system, NULL);
    double *hessian = malloc((size_t)n * (size_t)n * sizeof *hessian);
    double *gradient = malloc((size_t)n * sizeof *gradient);
    block *list = calloc((size_t)nblock + 1, sizeof *list);
    pm_status status = PM_OK;
    int index[SAMPLES], count = 0;
    if (hessian == NULL || gradient == NULL || list == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a spectrum");
        goto done;
    }
    for (; count < SAMPLES && count < all; ++count) {
        index[count] = (int)((long)count * all / (all < SAMPLES ? all : SAMPLES));
    }
    list_blocks(system, list);
    pm_gauss_newton_matrix_evaluate(normal, count, index, gradient, hessian);
    const int warmth = find_warmth(nblock, list);
    scale_matrix(n, hessian, gradient);
    if (warmth >= 0) {
        report_warmth(n, hessian, warmth, WARMER * gradient[warmth], out);
    }
    if (n <= MOST_DECOMPOSED) {
        status = report_flat(n, hessian, nblock, list, out);
    } else {
        report_unexamined(n, out);
    }
    fflush(out);
done:
    free(hessian);
    free(gradient);
    free(list);
    return status;
}

pm_status pm_spectrum_report(pm_objective *objective, FILE *out) {
    const int n = pm_objective_size(objective);
    pm_gauss_newton_matrix *normal = NULL;
    if (n > MOST_WEIGHTS) {
        report_unexamined(n, out);
    }
    if (n == 0 || n > MOST_WEIGHTS || pm_residuals_count(objective) > MOST_RESIDUALS) {
        return PM_OK;
    }
    PM_TRY(pm_gauss_newton_matrix_open(&normal, objective));
    const pm_status status = report(objective, normal, out);
    pm_gauss_newton_matrix_close(normal);
    return status;
}
