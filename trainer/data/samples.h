// Training samples: short windows of trajectories, in the coordinates of the scene's state.
#ifndef PM_TRAINER_DATA_SAMPLES_H
#define PM_TRAINER_DATA_SAMPLES_H

#include "scene/boundary_input.h"
#include "scene/columns.h"

// What a loss compares with the data: the states that steps of the integrator reach from the first
// state of a window, or the rates at this state.
typedef enum pm_residual { PM_RESIDUAL_STEP, PM_RESIDUAL_DERIVATIVE } pm_residual;

// `count` windows. A window holds 1 + unroll states [1 + unroll][nz], followed by the coefficients
// of the boundary inputs over its steps [unroll][input_order][nboundary_input]
// (pm_boundary_input_interval), and by the weights of the residuals [nz] if the samples are
// weighted. For the derivative residual unroll is 1 and the second state is z + dt zdot, where zdot
// are the rates of the dataset, or else differences of nine states, of order 8 (of five states
// where there are boundary inputs, and of all states of shorter trajectories). The differences of
// nine states are weighted by their accuracy, which a formula of seven states estimates. They are
// one-sided at the ends of a trajectory, since its first states are often like no others: where
// everything relaxes, currents are large there alone. Unweighted samples leave out these ends.
typedef struct pm_samples {
    pm_arena arena; // owns the arrays below
    int count, unroll, nz;
    int nboundary_input; // scene->nprescribed
    int input_order; // PM_BOUNDARY_INPUT_ORDER, or 1: only the values at the beginning of each step
    bool weighted;
    double *z;     // [count][pm_samples_width]
    double *scale; // [nz] root mean square of the increment of one step, pooled over each group
} pm_samples;

// Makes the windows of trajectories [first, end) of the dataset. The caller frees. PM_EDATA if the
// trajectories are too short; PM_ENOMEM.
pm_status pm_samples_make(pm_samples *samples, const pm_scene *scene, const pm_dataset *dataset,
                          int first, int end, pm_residual residual, int unroll, int input_order);
// Replaces entries of samples->scale by those of scale [nz] that are > 0; NULL has no effect.
void pm_samples_rescale(pm_samples *samples, const double *scale);
void pm_samples_free(pm_samples *samples);

// Returns the position in a window where the coefficients of the boundary inputs over step `step`
// begin.
static inline int pm_samples_input(const pm_samples *s, int step) {
    return (1 + s->unroll) * s->nz + step * s->input_order * s->nboundary_input;
}
// Returns the position in a window where the weights begin.
static inline int pm_samples_weights(const pm_samples *s) {
    return pm_samples_input(s, s->unroll);
}
// Returns the length of a window.
static inline int pm_samples_width(const pm_samples *s) {
    return pm_samples_weights(s) + (s->weighted ? s->nz : 0);
}

// Returns the number of coefficients that each window omits because input_order is less than
// PM_BOUNDARY_INPUT_ORDER. Decisions that depend on the size of a window must include them, so that
// results do not depend on input_order.
static inline int pm_samples_left_out(const pm_samples *s) {
    return s->unroll * (PM_BOUNDARY_INPUT_ORDER - s->input_order) * s->nboundary_input;
}

// Writes the window [pm_samples_width] of sample k.
void pm_samples_window(const pm_samples *s, int k, double *window);

#endif
