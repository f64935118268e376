// The normal equations of a loss: the Gauss-Newton approximation J^T J of its Hessian, where J is
// the Jacobian of the residuals of all samples with respect to all weights (Nocedal, Wright,
// Numerical Optimization, 2006, section 10.3).
#ifndef PM_TRAINER_LEARN_GAUSS_NEWTON_MATRIX_H
#define PM_TRAINER_LEARN_GAUSS_NEWTON_MATRIX_H

#include "learn/objective.h"

typedef struct pm_gauss_newton_matrix pm_gauss_newton_matrix;

// Prepares the Jacobian for the loss of `objective`, which must outlive the result. The caller
// closes it. PM_ENOMEM.
pm_status pm_gauss_newton_matrix_open(pm_gauss_newton_matrix **normal, pm_objective *objective);
void pm_gauss_newton_matrix_close(pm_gauss_newton_matrix *normal); // NULL is allowed

// Computes the gradient [n] and the upper triangle of the matrix hessian [n][n] of half the mean
// loss over the samples index [count], where n = pm_objective_size. The last call of
// pm_objective_evaluate must have covered these samples at the present weights, since this function
// uses the robust weights that it computed.
void pm_gauss_newton_matrix_evaluate(pm_gauss_newton_matrix *normal, int count, const int *index,
                                     double *gradient, double *hessian);

#endif
