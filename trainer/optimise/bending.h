// How residuals bend along a step: the second-order correction of Gauss-Newton steps.
//
// A step v of the damped equations (optimise/normal_equations.h) follows the tangent of the
// residuals r. In a narrow curved valley it soon leaves the valley, and the damping that keeps it
// there makes it short. The second derivative r'' of the residuals along v gives the
// acceleration a of the path that stays in it, (H + ...) a = -J^T W r'' / 2, with the matrix that
// v was solved with (Transtrum, Sethna, arXiv:1201.5885, 2012). r'' is a difference of three
// evaluations and J^T W r'' one reverse pass: together far less than the matrix.
#ifndef PM_TRAINER_OPTIMISE_BENDING_H
#define PM_TRAINER_OPTIMISE_BENDING_H

#include "loss/objective.h"

typedef struct pm_bending pm_bending;

// Prepares r'' of the loss of `objective`, which must outlive the result, on `most` samples at
// most. The caller closes it. PM_ENOMEM.
pm_status pm_bending_open(pm_bending **bending, pm_objective *objective, int most);
void pm_bending_close(pm_bending *bending); // NULL is allowed

// Computes pull [n] = J^T W r'' / count at the weights theta [n] along step [n], on the samples
// index [count]; n is pm_objective_size. It leaves `theta` in the objective, whose last evaluation
// covers these samples.
void pm_bending_pull(pm_bending *bending, int count, const int *index, const double *theta,
                     const double *step, double *pull);

#endif
