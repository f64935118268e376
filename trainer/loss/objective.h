// The loss of a system on samples, and its gradient with respect to all weights.
//
//     loss = mean over samples of rho( mean over steps and components of ((z - z_data) / scale)^2 )
//            + degeneracy weight * mean over steps of |L dS|^2 + |M dE|^2 (soft form)
//     rho(x) = x, or with a robust loss: D^2 ln(1 + x / D^2), which reduces the weight of outliers
//
// Two threads, or the processes of a team (loss/team.h), work on chunks of samples. The chunks are
// summed in a fixed order, so that the result does not depend on the number of processors, nor of
// processes in the team. All processes of a team must call the same functions in the same order.
#ifndef PM_TRAINER_LOSS_OBJECTIVE_H
#define PM_TRAINER_LOSS_OBJECTIVE_H

#include "loss/loss_graph.h"

typedef struct pm_objective pm_objective;

// Prepares the loss of `system` on `samples`, which must both outlive it. `loss` is copied. The
// caller closes it. PM_ENOMEM.
pm_status pm_objective_open(pm_objective **objective, pm_system *system, const pm_samples *samples,
                            const pm_loss *loss);
void pm_objective_close(pm_objective *objective); // NULL is allowed

int pm_objective_samples(const pm_objective *o); // the number of samples
// Returns the number of residuals of one sample without the penalty of the soft form: the number of
// variables times the number of steps of a window, and one more for the energy balance.
int pm_objective_residual_count(const pm_objective *o);

int pm_objective_size(const pm_objective *o); // the number of weights
// These functions copy all weights from the system to theta [pm_objective_size], and back.
void pm_objective_weights(const pm_objective *o, double *theta);
void pm_objective_set_weights(pm_objective *o, const double *theta);

// Returns the loss at the present weights of the system. Writes its gradient [pm_objective_size]
// unless `gradient` is NULL; the loss alone takes a fraction of the time. The mean is over the
// samples index [count], which are different, or over all samples if `index` is NULL.
double pm_objective_evaluate(pm_objective *o, int count, const int *index, double *gradient);

// Sets the robust scale D^2 = d^2 times the median squared residual of the samples index [count]
// (all if `index` is NULL), as last evaluated; d is `robust` of pm_loss. Has no effect if the loss
// is not robust. PM_ENOMEM.
pm_status pm_objective_rescale(pm_objective *o, int count, const int *index);
// These functions return and set D^2. A training that is resumed restores it.
double pm_objective_robust_square(const pm_objective *o);
void pm_objective_set_robust_square(pm_objective *o, double square);

// The arguments with which an objective was opened. All pointers are borrowed from it.
typedef struct pm_loss_context {
    pm_system *system;
    const pm_samples *samples;
    const pm_loss *loss;
} pm_loss_context;
pm_loss_context pm_objective_context(const pm_objective *o);
// Returns the weight of a sample in the Gauss-Newton matrix: rho'(x) as last evaluated, times the
// importance of the sample.
double pm_objective_sample_weight(const pm_objective *o, int sample);
// Returns x rho'(x) of a sample, as last evaluated: its share in the loss as the matrix sees it.
double pm_objective_sample_share(const pm_objective *o, int sample);
// Sets the factors [pm_objective_samples] by which pm_objective_sample_weight multiplies the
// weights of the samples. If a batch contains samples with unequal probabilities, each factor is in
// proportion to the inverse of the probability. NULL, the initial value, stands for 1. The array is
// borrowed. The loss itself does not depend on it.
void pm_objective_set_importance(pm_objective *o, const double *importance);

// Computes the median and the mean, over all samples, of the mean squared scaled residual, as last
// evaluated. PM_ENOMEM.
pm_status pm_objective_residuals(const pm_objective *o, double *median, double *mean);

#endif
