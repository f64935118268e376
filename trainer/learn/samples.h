// Training samples: short windows of trajectories in the scene's own states.
#ifndef PM_TRAINER_LEARN_SAMPLES_H
#define PM_TRAINER_LEARN_SAMPLES_H

#include "scene/boundary_input.h"
#include "scene/columns.h"

typedef enum pm_residual { PM_RESIDUAL_STEP, PM_RESIDUAL_DERIVATIVE } pm_residual;

// count windows of 1 + unroll states [1 + unroll][nz], each with what the loads prescribe over its
// steps, [unroll][input_order][nload] (pm_boundary_input_interval). For the derivative residual
// unroll is 1 and the second state is z + dt zdot, with the data's rates, or if they have none with
// zdot by central differences of fourth order.
typedef struct pm_symmetry pm_symmetry; // learn/symmetry.h

typedef struct pm_samples {
    pm_arena arena; // owns all that follows, but for the symmetry
    int count, unroll, nz;
    int nboundary_input; // scene->nprescribed
    int input_order;     // PM_BOUNDARY_INPUT_ORDER, or 1: only what they prescribe as steps begin
    double *z;           // [count][pm_samples_width]
    double *scale;       // [nz] root mean square of the one-step increment, pooled over each group
    const pm_symmetry *symmetry; // whose images of each window count as samples too, or NULL
} pm_samples;

// From trajectories [first, end) of the data. PM_EDATA if they are too short; PM_ENOMEM.
pm_status pm_samples_make(pm_samples *samples, const pm_scene *scene, const pm_dataset *dataset,
                          int first, int end, pm_residual residual, int unroll, int input_order);
// Takes scale [nz] where it is > 0; NULL: nothing to do.
void pm_samples_rescale(pm_samples *samples, const double *scale);
void pm_samples_free(pm_samples *samples);

// Where a window's loads over step `step` begin, and numbers in a window.
static inline int pm_samples_load(const pm_samples *s, int step) {
    return (1 + s->unroll) * s->nz + step * s->input_order * s->nboundary_input;
}
static inline int pm_samples_width(const pm_samples *s) {
    return pm_samples_load(s, s->unroll);
}

// Numbers that a window has not because of input_order. Whatever chooses by size counts them too,
// so that training has the same bits however much of the loads is kept.
static inline int pm_samples_left_out(const pm_samples *s) {
    return s->unroll * (PM_BOUNDARY_INPUT_ORDER - s->input_order) * s->nboundary_input;
}

// Samples with all derived: sample k is image k / count of window k % count.
int pm_samples_symmetry_copies(const pm_samples *s);
// Writes the window of sample k [pm_samples_width].
void pm_samples_window(const pm_samples *s, int k, double *window);

#endif
