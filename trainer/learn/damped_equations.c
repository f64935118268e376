// Solves the damped normal equations with or without a matrix.
#include "learn/damped_equations.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"

// A weight without any effect at present still gets a positive diagonal entry, in units of the
// largest one.
#define SMALLEST_DIAGONAL 1e-10
// Conjugate gradients end when the last tenth of the iterations, at least FEWEST, has lowered the
// quadratic model of the loss by less than PROGRESS of its decrease for each of them (Martens, ICML
// 2010, section 4.4).
#define FEWEST_ITERATIONS 10
#define PROGRESS 5e-3
// The width of a step of a weight that is held, which is the logarithm of a constant.
#define HELD_WIDTH 0.1

// --- opening ---

static pm_status open_matrix(pm_damped_equations *e, pm_objective *objective) {
    const size_t n = (size_t)e->size;
    e->hessian = malloc(n * n * sizeof *e->hessian);
    e->damped = malloc(n * n * sizeof *e->damped);
    if (e->hessian == NULL || e->damped == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the normal equations of %zu weights", n);
    }
    return pm_gauss_newton_matrix_open(&e->matrix, objective);
}

static pm_status open_product(pm_damped_equations *e, pm_objective *objective) {
    const size_t n = (size_t)e->size;
    e->residual = malloc(n * sizeof *e->residual);
    e->conditioned = malloc(n * sizeof *e->conditioned);
    e->direction = malloc(n * sizeof *e->direction);
    e->image = malloc(n * sizeof *e->image);
    if (e->residual == NULL || e->conditioned == NULL || e->direction == NULL || e->image == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for conjugate gradients with %zu weights", n);
    }
    return pm_gauss_newton_product_open(&e->product, objective);
}

// Marks the weights that are held, and those that shrink.
static void mark(pm_damped_equations *e) {
    const pm_system *system = pm_objective_context(e->objective).system;
    size_t at = 0;
    for (int i = 0; i < pm_system_components(system); ++i) {
        const pm_params *params = pm_system_params(system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const size_t size = (size_t)entry->rows * (size_t)entry->cols;
            for (size_t j = 0; entry->trained && j < size; ++j) {
                e->shrinks[at] = entry->shrinks;
                e->held[at++] = entry->held;
            }
        }
    }
}

pm_status pm_damped_equations_open(pm_damped_equations *e, pm_objective *objective, bool matrix) {
    *e = (pm_damped_equations){.size = pm_objective_size(objective), .objective = objective};
    const size_t n = (size_t)e->size;
    e->gradient = malloc(n * sizeof *e->gradient);
    e->diagonal = malloc(n * sizeof *e->diagonal);
    e->held = calloc(n, sizeof *e->held);
    e->shrinks = calloc(n, sizeof *e->shrinks);
    e->bend = calloc(n, sizeof *e->bend);
    if (e->gradient == NULL || e->diagonal == NULL || e->held == NULL || e->shrinks == NULL ||
        e->bend == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the normal equations of %zu weights", n);
    }
    mark(e);
    return matrix ? open_matrix(e, objective) : open_product(e, objective);
}

void pm_damped_equations_close(pm_damped_equations *e) {
    pm_gauss_newton_matrix_close(e->matrix);
    pm_gauss_newton_product_close(e->product);
    free(e->gradient);
    free(e->diagonal);
    free(e->held);
    free(e->shrinks);
    free(e->bend);
    free(e->hessian);
    free(e->damped);
    free(e->residual);
    free(e->conditioned);
    free(e->direction);
    free(e->image);
}

void pm_damped_equations_linearise(pm_damped_equations *e, int count, const int *index,
                                   uint64_t seed, double loss, const double *theta) {
    e->count = count;
    e->index = index;
    e->hold = loss / (HELD_WIDTH * HELD_WIDTH);
    if (e->matrix != NULL) {
        pm_gauss_newton_matrix_evaluate(e->matrix, count, index, e->gradient, e->hessian);
        for (size_t i = 0; i < (size_t)e->size; ++i) {
            e->diagonal[i] = e->hessian[i * (size_t)e->size + i];
        }
    } else {
        pm_gauss_newton_product_linearise(e->product, count, index, seed, e->gradient, e->diagonal);
    }
    double largest = 0;
    for (int i = 0; i < e->size; ++i) {
        largest = fmax(largest, e->diagonal[i]);
    }
    for (int i = 0; i < e->size; ++i) {
        e->diagonal[i] += SMALLEST_DIAGONAL * largest;
        e->bend[i] = 3 * e->shrinkage * e->shrinks[i] * theta[i] * theta[i];
        e->gradient[i] += e->bend[i] * theta[i] / 3;
    }
}

double pm_damped_equations_penalty(const pm_damped_equations *e, const double *theta) {
    double sum = 0;
    for (int i = 0; i < e->size; ++i) {
        sum += e->shrinks[i] * pow(theta[i], 4);
    }
    return e->shrinkage / 4 * sum;
}

// Returns the diagonal of R + S + near I.
static double ridge(const pm_damped_equations *e, size_t i) {
    return e->hold * e->held[i] + e->bend[i] + e->near;
}

// --- Cholesky ---

static bool solve_by_factors(pm_damped_equations *e, double damping, double *step) {
    const size_t n = (size_t)e->size;
    memcpy(e->damped, e->hessian, n * n * sizeof *e->damped);
    for (size_t i = 0; i < n; ++i) {
        e->damped[i * n + i] += damping * e->diagonal[i] + ridge(e, i);
        step[i] = -e->gradient[i];
    }
    for (size_t i = 0; i < n && e->frozen != NULL; ++i) {
        for (size_t j = 0; j < n && e->frozen[i]; ++j) {
            e->damped[i * n + j] = e->damped[j * n + i] = i == j ? 1 : 0;
        }
        step[i] = e->frozen[i] ? 0 : step[i];
    }
    return pm_cholesky_solve(e->size, e->damped, step);
}

// --- conjugate gradients ---

static double dot(int n, const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
}

static bool is_frozen(const pm_damped_equations *e, int i) {
    return e->frozen != NULL && e->frozen[i];
}

// Computes image = (H + R + damping D + near I) vector without the rows of frozen weights.
static void multiply(pm_damped_equations *e, double damping, const double *vector, double *image) {
    pm_gauss_newton_product_apply(e->product, e->count, e->index, vector, image);
    for (int i = 0; i < e->size; ++i) {
        image[i] += (damping * e->diagonal[i] + ridge(e, (size_t)i)) * vector[i];
        image[i] = is_frozen(e, i) ? 0 : image[i];
    }
}

// Divides the residual by the diagonal of the damped matrix, and returns their product.
static double condition(pm_damped_equations *e, double damping) {
    for (int i = 0; i < e->size; ++i) {
        e->conditioned[i] = e->residual[i] / ((1 + damping) * e->diagonal[i] + ridge(e, (size_t)i));
    }
    return dot(e->size, e->residual, e->conditioned);
}

// Starts with the guess if that is better than zero, and returns the quadratic model of the loss
// there, g.x + x.(H + damping D + near I)x / 2. The guess must be zero for frozen weights.
static double start(pm_damped_equations *e, double damping, double *step) {
    const int n = e->size;
    double model = 0;
    if (dot(n, step, step) > 0) {
        multiply(e, damping, step, e->image);
        model = dot(n, e->gradient, step) + 0.5 * dot(n, step, e->image);
    }
    const bool keep = model < 0;
    for (int i = 0; i < n; ++i) {
        step[i] = keep ? step[i] : 0;
        e->residual[i] = is_frozen(e, i) ? 0 : -e->gradient[i] - (keep ? e->image[i] : 0);
    }
    return keep ? model : 0;
}

// Preconditioned conjugate gradients (Nocedal, Wright, algorithm 5.3).
static bool solve_by_products(pm_damped_equations *e, double damping, int most, double *step) {
    const int n = e->size;
    double before[PM_MOST_CONJUGATE_GRADIENTS + 1]; // the model after each iteration
    before[0] = start(e, damping, step);
    double rho = condition(e, damping);
    memcpy(e->direction, e->conditioned, (size_t)n * sizeof *e->direction);
    for (int k = 1; k <= most && rho > 0; ++k) {
        multiply(e, damping, e->direction, e->image);
        const double curvature = dot(n, e->direction, e->image);
        if (!(curvature > 0) || !isfinite(curvature)) {
            return isfinite(curvature) && k > 1;
        }
        const double length = rho / curvature;
        for (int i = 0; i < n; ++i) {
            step[i] += length * e->direction[i];
            e->residual[i] -= length * e->image[i];
        }
        before[k] = before[k - 1] - 0.5 * length * rho;
        const int lag = k / 10 > FEWEST_ITERATIONS ? k / 10 : FEWEST_ITERATIONS;
        if (k > lag && before[k - lag] - before[k] < lag * PROGRESS * -before[k]) {
            break;
        }
        const double next = condition(e, damping);
        for (int i = 0; i < n; ++i) {
            e->direction[i] = e->conditioned[i] + next / rho * e->direction[i];
        }
        rho = next;
    }
    return true;
}

bool pm_damped_equations_solve(pm_damped_equations *e, const double *theta, double damping,
                               int most, double *step) {
    if (e->matrix != NULL) {
        return solve_by_factors(e, damping, step);
    }
    pm_objective_set_weights(e->objective, theta);
    assert(most <= PM_MOST_CONJUGATE_GRADIENTS);
    return solve_by_products(e, damping, most, step);
}
