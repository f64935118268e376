// The loss of a system on samples, and its gradient with respect to all weights.
//
//     loss = mean over samples of rho( mean over steps and components of ((z - z_data) / scale)^2 )
//            + degeneracy weight * mean squared degeneracy residual (soft form)
// rho(x) = x, or robust: d^2 ln(1 + x / d^2), which lets single wild samples count less.
//
// Samples are worked on in chunks by two threads; chunk by chunk the sums run in a fixed order, so
// that the result does not depend on the number of processors.
#ifndef PM_TRAINER_LEARN_OBJECTIVE_H
#define PM_TRAINER_LEARN_OBJECTIVE_H

#include "learn/loss_graph.h"

typedef struct pm_objective pm_objective;

// `system` and `samples` must outlive it. PM_ENOMEM.
pm_status pm_objective_open(pm_objective **objective, pm_system *system, const pm_samples *samples,
                            const pm_loss *loss);
void pm_objective_close(pm_objective *objective); // NULL is allowed

int pm_objective_samples(const pm_objective *o); // number of samples
int pm_objective_symmetry_copies(
    const pm_objective *o);                   // with their symmetric images (learn/samples.h)
int pm_objective_size(const pm_objective *o); // number of weights
void pm_objective_weights(const pm_objective *o, double *theta);     // read from the system
void pm_objective_set_weights(pm_objective *o, const double *theta); // written to the system

// Loss and gradient [size] at the system's present weights, over the samples index[0 .. count), or
// over all, as they stand, if index is NULL. An index names a sample or one of its images, of each
// sample one at most.
double pm_objective_evaluate(pm_objective *o, int count, const int *index, double *gradient);

// Sets the robust scale from the residuals of these samples (all if index is NULL) in the last
// evaluation that covered them. No effect if robust is 0. PM_ENOMEM.
pm_status pm_objective_rescale(pm_objective *o, int count, const int *index);
// The square of that scale, for taking up a training where it was left.
double pm_objective_robust_square(const pm_objective *o);
void pm_objective_set_robust_square(pm_objective *o, double square);

// What it is made of, and after an evaluation rho'(x) of a sample it covered: for a Gauss-Newton
// approximation (learn/gauss_newton_matrix.h).
typedef struct pm_loss_context {
    pm_system *system;
    const pm_samples *samples;
    const pm_loss *loss;
} pm_loss_context;
pm_loss_context pm_objective_context(const pm_objective *o);
double pm_objective_sample_weight(const pm_objective *o, int sample);

// Median and mean over all samples of the mean squared scaled residual, as last evaluated.
pm_status pm_objective_residuals(const pm_objective *o, double *median, double *mean);

#endif
