// Adds up and solves the normal equations.
#include "modal/regression.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"

// A feature counts as zero if its mean square is below this fraction of the largest mean square.
// The rounding of a sum of n terms that cancel leaves about n^2 DBL_EPSILON^2, 5e-26 for a thousand
// terms, and its bits depend on the processor. The margin beyond that is a factor of 1e5.
#define NEVER 1e-20

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a regression");
}

pm_status pm_regression_open(pm_regression *r, int nfeature, int nresult) {
    const size_t p = (size_t)nfeature, m = (size_t)nresult;
    *r = (pm_regression){
        .nfeature = nfeature,
        .nresult = nresult,
        .gram = calloc(p * p, sizeof(double)),
        .cross = calloc(p * m, sizeof(double)),
        .product = calloc(p * m, sizeof(double)),
    };
    if (r->gram == NULL || r->cross == NULL || r->product == NULL) {
        pm_regression_close(r);
        return no_memory();
    }
    return PM_OK;
}

void pm_regression_close(pm_regression *r) {
    free(r->gram);
    free(r->cross);
    free(r->product);
    *r = (pm_regression){0};
}

void pm_regression_add(pm_regression *r, int count, const double *features, const double *results) {
    const size_t size = (size_t)r->nfeature * (size_t)r->nresult;
    pm_gram_add(count, r->nfeature, features, r->gram);
    pm_gemm(true, false, r->nfeature, r->nresult, count, features, results, r->product);
    for (size_t i = 0; i < size; ++i) {
        r->cross[i] += r->product[i];
    }
}

pm_status pm_regression_solve(pm_regression *r, double ridge) {
    const size_t p = (size_t)r->nfeature;
    double largest = 0;
    for (size_t i = 0; i < p; ++i) {
        largest = fmax(largest, r->gram[i * p + i]);
    }
    for (size_t i = 0; i < p; ++i) {
        double *diagonal = &r->gram[i * p + i];
        *diagonal = *diagonal > NEVER * largest ? *diagonal * (1 + ridge) : largest;
    }
    if (!pm_cholesky_factor(r->nfeature, r->gram)) {
        return pm_fail(PM_ENUMERIC, "a regression on %d features does not determine them",
                       r->nfeature);
    }
    pm_cholesky_back(r->nfeature, r->gram, r->nresult, r->cross);
    return PM_OK;
}

// Computes product = u cross, where gram = u^T u is the Cholesky factorization.
static void multiply_factor(const pm_regression *r, double *u, double *product) {
    const size_t p = (size_t)r->nfeature;
    for (size_t i = 0; i < p; ++i) {
        memset(u + i * p, 0, i * sizeof *u);
        memcpy(u + i * p + i, r->gram + i * p + i, (p - i) * sizeof *u);
    }
    pm_gemm(false, false, r->nfeature, r->nresult, r->nfeature, u, r->cross, product);
}

pm_status pm_regression_compress(const pm_regression *r, int rank, double *coefficient,
                                 double *pattern) {
    const int p = r->nfeature, m = r->nresult;
    double *u = malloc((size_t)p * (size_t)p * sizeof *u);
    double *square = malloc((size_t)p * (size_t)p * sizeof *square);
    double *product = malloc((size_t)p * (size_t)m * sizeof *product);
    double *vector = malloc((size_t)rank * (size_t)p * sizeof *vector);
    double *value = malloc((size_t)rank * sizeof *value);
    pm_status status = PM_OK;
    if (u == NULL || square == NULL || product == NULL || vector == NULL || value == NULL) {
        status = no_memory();
        goto done;
    }
    multiply_factor(r, u, product);
    pm_gemm(false, true, p, p, m, product, product, square);
    if (!pm_eigen_largest(p, square, rank, value, vector)) {
        status = pm_fail(PM_ENUMERIC, "no eigenvectors of a regression on %d features", p);
        goto done;
    }
    pm_gemm(false, false, rank, m, p, vector, product, pattern);
    // coefficient = u^-1 vector^T = (u^T u)^-1 u^T vector^T
    pm_gemm(true, true, p, rank, p, u, vector, coefficient);
    pm_cholesky_back(p, u, rank, coefficient);
done:
    free(u);
    free(square);
    free(product);
    free(vector);
    free(value);
    return status;
}
