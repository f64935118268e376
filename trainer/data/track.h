// Measured trajectories as a fit uses them: samples at rising times, and the integration intervals
// between them.
#ifndef PM_TRAINER_DATA_TRACK_H
#define PM_TRAINER_DATA_TRACK_H

#include "data/observation.h"

// One measured trajectory.
typedef struct pm_track {
    int count;        // samples
    double *time;     // [count] s
    double *y;        // [count][ny]; NaN where nothing was measured
    int *sample;      // [count] their positions in the trajectory of the dataset
    int *first_step;  // [count] the first of the steps until the next sample; the last: all steps
    double *duration; // [steps] the length of each step in dt of the scene
    // [steps][PM_BOUNDARY_INPUT_ORDER][nprescribed] the boundary inputs over each step
    // (scene/boundary_input.h), and [count][nprescribed] their values at the samples; NULL: none
    double *input, *now;
} pm_track;

typedef struct pm_tracks {
    pm_arena arena; // owns all
    int count, ny;
    pm_track *track;   // [count]
    bool stretched;    // some step is not dt long
    double *deviation; // [ny] standard deviation of each column over all samples
} pm_tracks;

// Makes the tracks of the trajectories `which` [count] of a measured dataset, from their first
// sample until `until` seconds later (INFINITY: all). Between two samples, and between two jumps of
// boundary inputs, steps are equal and at most one dt of the scene long. With `thin`, a track has
// samples that are about dt apart: after each one the one nearest to dt later. The caller frees.
// PM_EDATA: a trajectory has fewer than two samples, or a column of a boundary input has none;
// PM_ENOMEM.
pm_status pm_tracks_make(pm_tracks *tracks, const pm_scene *scene, const pm_observation *o,
                         const pm_dataset *dataset, int count, const int *which, double until,
                         bool thin);
void pm_tracks_free(pm_tracks *tracks);

// Writes the states of track `id` at multiples of dt of the scene to state [ntime][nz]. A measured
// component is interpolated by a polynomial through the nearest four samples that hold it. A hidden
// component is its guess. Columns of formulas are not used.
void pm_track_states(const pm_tracks *tracks, int id, const pm_scene *scene,
                     const pm_observation *o, int ntime, double *state);
// Writes the states of track `id` at the times of its samples `first` to `end` - 1 to state [end -
// first][nz], interpolated as pm_track_states does.
void pm_track_sample_states(const pm_tracks *tracks, int id, const pm_scene *scene,
                            const pm_observation *o, int first, int end, double *state);

#endif
