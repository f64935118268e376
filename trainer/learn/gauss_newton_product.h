// Products of the Gauss-Newton matrix J^T W J with vectors, where neither the Jacobian J of the
// residuals nor the matrix is formed (Schraudolph, Neural Computation 14 (2002) 1723). A reverse
// pass computes J^T u as a function of u. This function is linear, and the reverse pass through it
// computes J v. One more reverse pass multiplies W J v by J^T. A product costs about as much as
// three gradients, for any number of weights and residuals.
#ifndef PM_TRAINER_LEARN_GAUSS_NEWTON_PRODUCT_H
#define PM_TRAINER_LEARN_GAUSS_NEWTON_PRODUCT_H

#include <stdint.h>

#include "learn/objective.h"

typedef struct pm_gauss_newton_product pm_gauss_newton_product;

// Prepares products for the loss of `objective`, which must outlive the result. The caller closes
// it. PM_ENOMEM.
pm_status pm_gauss_newton_product_open(pm_gauss_newton_product **product, pm_objective *objective);
void pm_gauss_newton_product_close(pm_gauss_newton_product *product); // NULL is allowed

// Computes the gradient [n] of half the mean loss over the samples index [count], where n =
// pm_objective_size, and an estimate of the diagonal [n] of the matrix: the mean square of J^T u
// over random signs u, which `seed` decides (Bekas, Kokiopoulou, Saad, Appl. Numer. Math. 57 (2007)
// 1214). The last call of pm_objective_evaluate must have covered these samples at the present
// weights, since this function uses the robust weights that it computed.
void pm_gauss_newton_product_linearise(pm_gauss_newton_product *product, int count,
                                       const int *index, uint64_t seed, double *gradient,
                                       double *diagonal);

// Computes result [n] = matrix * vector [n], with the matrix of half the mean loss over the samples
// index [count] at the present weights. The robust weights are those of the last evaluation.
void pm_gauss_newton_product_apply(pm_gauss_newton_product *product, int count, const int *index,
                                   const double *vector, double *result);

#endif
