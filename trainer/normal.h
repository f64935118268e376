// The normal equations of a loss: the Gauss-Newton approximation of its Hessian, from the Jacobian
// of every sample's residuals with respect to every weight.
#ifndef PM_TRAINER_NORMAL_H
#define PM_TRAINER_NORMAL_H

#include "objective.h"

typedef struct pm_normal pm_normal;

// For the loss of `objective`, which must outlive it. PM_ENOMEM.
pm_status pm_normal_open(pm_normal **normal, pm_objective *objective);
void pm_normal_close(pm_normal *normal); // NULL is allowed

// gradient [n] and the upper triangle of hessian [n][n] of half the loss over the samples
// index [count], at the weights of the last pm_objective_evaluate over them (whose robust weights
// are used).
void pm_normal_evaluate(pm_normal *normal, int count, const int *index, double *gradient,
                        double *hessian);

#endif
