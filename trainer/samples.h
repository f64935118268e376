// Training samples: short windows of trajectories in the scene's own states.
#ifndef PM_TRAINER_SAMPLES_H
#define PM_TRAINER_SAMPLES_H

#include "store/columns.h"

typedef enum pm_residual { PM_RESIDUAL_STEP, PM_RESIDUAL_DERIVATIVE } pm_residual;

// count windows of 1 + unroll states, [count][1 + unroll][nz]. For the derivative residual unroll
// is 1 and the second state is z + dt zdot, with zdot by central differences of fourth order.
typedef struct pm_samples {
    pm_arena arena; // owns all that follows
    int count, unroll, nz;
    double *z;
    double *scale; // [nz] root mean square of the one-step increment, pooled over each group
} pm_samples;

// From trajectories [first, end) of the data. PM_EDATA if they are too short; PM_ENOMEM.
pm_status pm_samples_make(pm_samples *samples, const pm_scene *scene, const pm_dataset *dataset,
                          int first, int end, pm_residual residual, int unroll);
void pm_samples_free(pm_samples *samples);

#endif
