// The normal equations of a loss: the Gauss-Newton approximation of its Hessian, from the Jacobian
// of every sample's residuals with respect to every weight.
#ifndef PM_TRAINER_LEARN_GAUSS_NEWTON_MATRIX_H
#define PM_TRAINER_LEARN_GAUSS_NEWTON_MATRIX_H

#include "learn/objective.h"

typedef struct pm_gauss_newton_matrix pm_gauss_newton_matrix;

// For the loss of `objective`, which must outlive it. PM_ENOMEM.
pm_status pm_gauss_newton_matrix_open(pm_gauss_newton_matrix **normal, pm_objective *objective);
void pm_gauss_newton_matrix_close(pm_gauss_newton_matrix *normal); // NULL is allowed

// gradient [n] and the upper triangle of hessian [n][n] of half the loss over the samples
// index [count], at the weights of the last pm_objective_evaluate over them (whose robust weights
// are used).
void pm_gauss_newton_matrix_evaluate(pm_gauss_newton_matrix *normal, int count, const int *index,
                                     double *gradient, double *hessian);

#endif
