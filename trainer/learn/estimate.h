// Starts of measured trajectories that no fit has seen: the state at the first sample that explains
// the first samples best, with the weights as they are; and the prediction from there.
#ifndef PM_TRAINER_LEARN_ESTIMATE_H
#define PM_TRAINER_LEARN_ESTIMATE_H

#include <signal.h>

#include "learn/uncertainty.h"
#include "sim/score.h"

// How starts are estimated.
typedef struct pm_estimate_how {
    double seconds;                    // the first seconds of each trajectory
    const pm_uncertainty *uncertainty; // of the weights: gives noise and bands; or NULL
    const volatile sig_atomic_t *stop; // ends the work when nonzero; or NULL
} pm_estimate_how;

// The result for some trajectories of a measured dataset.
typedef struct pm_estimate {
    pm_arena arena; // owns all
    int count, ntime, ny, nz;
    double *start; // [count][nz] states at the first samples
    double *noise; // [ny] residual of the estimates, in units of the columns
    double *y;     // [count][ntime][ny] predicted columns at all times of the dataset; NaN beyond
    double *z;     // [count][ntime][nz] predicted states
    // [count][ntime][ny] standard deviation of a measurement from its prediction: by the weights,
    // the start and the noise. NULL without pm_estimate_how.uncertainty.
    double *deviation;
} pm_estimate;

// Estimates the starts of trajectories which [count] and predicts all samples. Those after the
// first seconds have no influence. The caller frees. PM_EDATA: fewer than two samples in this time;
// PM_ENUMERIC, PM_EINTERRUPTED, PM_ENOMEM.
pm_status pm_estimate_make(pm_estimate *e, pm_system *system, const pm_observation *o,
                           const pm_dataset *dataset, int count, const int *which,
                           const pm_estimate_how *how);
void pm_estimate_free(pm_estimate *e); // zeroed storage is allowed

// Returns the relative L2 error of one column of estimate `id`, trajectory which[id], after the
// first seconds: over the deviation of the measurements from their mean there. NAN: nothing is
// measured there; infinite: the prediction is not finite.
double pm_estimate_error(const pm_estimate *e, const pm_observation *o, const pm_dataset *dataset,
                         const int *which, double seconds, int id, int column);
// The distribution of these errors over all trajectories.
pm_box pm_estimate_errors(const pm_estimate *e, const pm_observation *o, const pm_dataset *dataset,
                          const int *which, double seconds, int column);
// Returns the part of the measurements of a column after the first seconds that lie within `width`
// standard deviations of the prediction.
double pm_estimate_coverage(const pm_estimate *e, const pm_observation *o,
                            const pm_dataset *dataset, const int *which, double seconds, int column,
                            double width);

#endif
