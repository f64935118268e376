// Starts of measured trajectories that no fit has seen: the state at the first sample that explains
// the first samples best, with the weights as they are; and the prediction from there.
#ifndef PM_TRAINER_LEARN_ESTIMATE_H
#define PM_TRAINER_LEARN_ESTIMATE_H

#include <signal.h>

#include "learn/observation.h"

// The result for some trajectories of a measured dataset.
typedef struct pm_estimate {
    pm_arena arena; // owns all
    int count, ntime, ny, nz;
    double *start; // [count][nz] states at the first samples
    double *noise; // [ny] residual of the estimates, in units of the columns
    double *y;     // [count][ntime][ny] predicted columns at all times of the dataset; NaN beyond
    double *z;     // [count][ntime][nz] predicted states
} pm_estimate;

// Estimates the starts of trajectories which [count] from their first `seconds` and predicts all
// later samples. Samples after these seconds have no influence. The caller frees. PM_EDATA: fewer
// than two samples in this time; PM_ENUMERIC, PM_EINTERRUPTED, PM_ENOMEM.
pm_status pm_estimate_make(pm_estimate *e, pm_system *system, const pm_observation *o,
                           const pm_dataset *dataset, int count, const int *which, double seconds,
                           const volatile sig_atomic_t *stop);
void pm_estimate_free(pm_estimate *e); // zeroed storage is allowed

#endif
