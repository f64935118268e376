// The error of a model as a part of the bands of its predictions. The covariance of the weights
// says how far noise can move the weights of a model that is right. What is wrong with a model, and
// what differs between trajectories, shows when trajectories are predicted that the fit has not
// seen (cross-validation; Stone, J. R. Stat. Soc. B 36, 1974).
#ifndef PM_TRAINER_INFERENCE_CALIBRATION_H
#define PM_TRAINER_INFERENCE_CALIBRATION_H

#include "inference/estimate.h"

typedef struct pm_calibration_how {
    const pm_dataset *data; // the measurements
    const int *which;       // [s->tracks->count] the trajectories of the fit
    int nheld;              // trajectories that the fit has not used
    const int *held;        // [nheld]
    double until;           // s; nothing that is measured later counts; 0: all
    double work;            // pm_shooting.work that continued fits may do; 0: no limit
    // [ny] receives the median error of predicted trajectories, relative to the deviation of a
    // column (pm_estimate_error), or NAN if nothing is predicted; NULL: it does not.
    double *error;
    const volatile sig_atomic_t *stop; // ends the work when nonzero; or NULL
} pm_calibration_how;

// Sets u->scale. The deviation that bands assume for a measurement is
//
//     sqrt(variance of noise + variance of the estimated start + scale * variance by the weights)
//
// The scale is the smallest one, from 1 on, with which 90 % of the measurements of trajectories
// that the fit has not seen lie inside bands of 90 %. A measurement counts by the share of the
// third term in this sum, averaged over each trajectory, so that errors of a start do not count as
// errors of the model. The covariance of the weights itself counts as one more trajectory, whose
// errors are those that it leads to expect.
//
// The scale is at least (t/z)^2 (1 + N (1 - 1/u->inflation)), which follows for an unseen
// trajectory if each of the N trajectories of the fit has weights of its own, which differ at
// random (random effects). t is the quantile of Student's distribution with as many degrees of
// freedom as there are predicted trajectories, and z that of the normal distribution, both at 95 %,
// since few trajectories tell little about how much they differ.
//
// With four or more held trajectories, these are predicted. Otherwise the trajectories of the fit
// are divided into at most five folds. The fit goes on without a fold, and those of the fold are
// predicted. Starts are estimated from the first tenth. The scale remains 1 if there are fewer than
// two trajectories or no weights. The system and `s` have the same weights and starts afterwards.
// Prints how many trajectories were predicted, and the CPU time. PM_EINTERRUPTED, PM_ENOMEM.
pm_status pm_calibration_make(pm_uncertainty *u, pm_shooting *s, const pm_calibration_how *how);

#endif
