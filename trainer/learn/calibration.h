// The error of a model as a part of the bands of its predictions. The covariance of the weights
// says how far noise can move the weights of a model that is right. What is wrong with a model, and
// what differs between trajectories, shows when trajectories are predicted that the fit has not
// seen (cross-validation; Stone, J. R. Stat. Soc. B 36, 1974).
#ifndef PM_TRAINER_LEARN_CALIBRATION_H
#define PM_TRAINER_LEARN_CALIBRATION_H

#include "learn/estimate.h"

typedef struct pm_calibration_how {
    const pm_dataset *data;            // the measurements
    const int *which;                  // [s->tracks->count] the trajectories of the fit
    int nheld;                         // trajectories that the fit has not used
    const int *held;                   // [nheld]
    double until;                      // s; nothing that is measured later counts; 0: all
    const volatile sig_atomic_t *stop; // ends the work when nonzero; or NULL
} pm_calibration_how;

// Sets u->scale. A trajectory i that the fit has not seen shows errors whose variance, beyond noise
// and the estimate of its start, is k_i times that which u->covariance causes. The scale is
//
//     (t/z)^2 max(mean of k_i, 1 + N (1 - 1/u->inflation))
//
// The mean over n trajectories is weighted by inverse variances: all errors of one trajectory are
// so strongly correlated that they count as a single number. The second term is what follows for
// an unseen trajectory if each of the N trajectories of the fit has weights of its own, which
// differ at random (random effects). t is the quantile of Student's distribution with n degrees of
// freedom and z that of the normal distribution, both at 95 %, since few trajectories tell little
// about k.
//
// With four or more held trajectories, these are predicted. Otherwise the trajectories of the fit
// are divided into at most five folds. The fit goes on without a fold, and those of the fold are
// predicted. Starts are estimated from the first tenth. The scale remains 1 if there are fewer than
// two trajectories or no weights. The system and `s` have the same weights and starts afterwards.
// Prints how many trajectories were predicted, and the CPU time. PM_EINTERRUPTED, PM_ENOMEM.
pm_status pm_calibration_make(pm_uncertainty *u, pm_shooting *s, const pm_calibration_how *how);

#endif
