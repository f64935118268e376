// Estimates the starts of measured trajectories that no fit has seen. A start is the state at the
// first sample of a trajectory. The estimate is the start from which the model, with its present
// weights, best reproduces the samples of the first seconds. The trajectory is then predicted from
// this start.
#ifndef PM_TRAINER_INFERENCE_ESTIMATE_H
#define PM_TRAINER_INFERENCE_ESTIMATE_H

#include <signal.h>

#include "inference/uncertainty.h"
#include "sim/score.h"

// How starts are estimated.
typedef struct pm_estimate_how {
    double seconds;                    // how many seconds of each trajectory determine its start
    const pm_uncertainty *uncertainty; // of the weights, for pm_estimate.deviation; or NULL
    const volatile sig_atomic_t *stop; // ends the work when nonzero; or NULL
    double until;                      // score nothing that is measured later, s; 0: score all
    bool halve;                        // find pm_estimate.coarse
    double work; // of the shooting after which no other starts are tried; 0: no limit
} pm_estimate_how;

// The result for some trajectories of a measured dataset.
typedef struct pm_estimate {
    pm_arena arena;           // owns all
    int count, ntime, ny, nz; // trajectories, samples of each, measured columns, state components
    double until;             // s after the first sample; later measurements are not scored
    double work;              // of the shooting (shooting/shooting.h)
    // How far predictions with the steps of the scene are from those with half of them: the largest
    // root mean square of a column relative to its deviation. Set with pm_estimate_how.halve.
    double coarse;
    double *start; // [count][nz] states at the first samples
    double *noise; // [ny] noise estimated from the residuals of the first seconds, unit of column
    double *y;     // [count][ntime][ny] predicted columns; NaN where a trajectory has no sample
    double *z;     // [count][ntime][nz] predicted states; NaN where a trajectory has no sample
    // [count][ntime][ny] expected standard deviation of a measurement from its prediction, due to
    // the uncertainty of the weights and of the start, and to noise. NULL without
    // pm_estimate_how.uncertainty.
    double *deviation;
    // [count][ntime][ny] the part of the variance that the uncertainty of the weights causes, at a
    // scale of 1 (pm_uncertainty.scale). NULL without pm_estimate_how.uncertainty.
    double *by_weights;
    // [count][ntime][nz] standard deviation of the states z. NULL likewise.
    double *state_deviation;
} pm_estimate;

// Estimates the starts of the trajectories `which` [count] of the dataset and predicts all their
// samples. Samples later than how->seconds have no influence on the result. The caller frees.
// PM_EDATA: fewer than two samples within how->seconds; PM_ENUMERIC, PM_EINTERRUPTED, PM_ENOMEM.
pm_status pm_estimate_make(pm_estimate *e, pm_system *system, const pm_observation *o,
                           const pm_dataset *dataset, int count, const int *which,
                           const pm_estimate_how *how);
void pm_estimate_free(pm_estimate *e); // zeroed storage is allowed

// Returns the relative L2 error of the prediction of one column, for trajectory which[id] after
// `seconds`: its root mean square divided by the standard deviation of the whole trajectory, which
// may come to rest in between. NAN: nothing is measured after `seconds`; infinite: the prediction
// is not finite.
double pm_estimate_error(const pm_estimate *e, const pm_observation *o, const pm_dataset *dataset,
                         const int *which, double seconds, int id, int column);
// Returns the distribution of these errors over all trajectories.
pm_box pm_estimate_errors(const pm_estimate *e, const pm_observation *o, const pm_dataset *dataset,
                          const int *which, double seconds, int column);
// Returns what noise of this standard deviation leaves unexplained of these errors, in the median
// over all trajectories. Outliers of the measurements hardly count: they stand alone. NAN: as
// above, or memory ran out.
double pm_estimate_unexplained(const pm_estimate *e, const pm_observation *o,
                               const pm_dataset *dataset, const int *which, double seconds,
                               int column, double noise);
// Returns the typical error of the predictions of a column after `seconds`, relative to the
// deviation of the column, over all trajectories. The error follows from the median of the absolute
// errors, and the deviation from the mean distance of the measurements from their median. Both are
// scaled to the standard deviation of a normal distribution, so that a few outliers hardly count.
// NAN: there are no measurements, or memory ran out.
double pm_estimate_typical_error(const pm_estimate *e, const pm_observation *o,
                                 const pm_dataset *dataset, const int *which, double seconds,
                                 int column);
// Returns the fraction of the measurements of a column after `seconds` that lie within `width`
// standard deviations of their predictions; NAN if there are none.
double pm_estimate_coverage(const pm_estimate *e, const pm_observation *o,
                            const pm_dataset *dataset, const int *which, double seconds, int column,
                            double width);

#endif
