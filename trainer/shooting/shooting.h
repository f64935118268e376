// Multiple shooting (Bock, 1987): a fit to measurements, whose unknowns are the weights and the
// state at the start of every window of samples. It minimises
//
//     1/2 sum over samples and columns of huber((h(z(t)) - y)/noise)
//     + 1/2 sum over neighbouring windows and components of ((z at the end - next start)/gap)^2
//     + 1/2 sum over trajectories and hidden components of ((first start - guess)/deviation)^2
//     + 1/2 sum over weights of ((weight - first weight)/reach)^2
//
// by damped Gauss-Newton steps (Levenberg, 1944), where h(z) are the values of the measured columns
// in the state z, and the integrator computes z(t) from the start of the window. The starts are
// eliminated window by window, so that the cost grows linearly with the number of windows
// (pm_shooting_solve). As `gap` shrinks, the windows of a trajectory join to one solution.
#ifndef PM_TRAINER_SHOOTING_SHOOTING_H
#define PM_TRAINER_SHOOTING_SHOOTING_H

#include <signal.h>

#include "base/progress.h"
#include "loss/team.h"
#include "shooting/sensitivity.h"

#define PM_SHOOTING_REACH 10.0  // `reach` of the logarithm of a positive constant
#define PM_SHOOTING_SPEED 1.5e9 // multiplications in a second of CPU time on a nominal machine

// A window: the samples [first, last) of a track, where the integration ends at sample `last` if
// another window follows, else at `last - 1`.
typedef struct pm_window {
    int track, first, last;
    bool follows; // it begins where the window before ends
    bool ends;    // no window of its track follows
} pm_window;

// How the terms of the objective count. The caller changes them between minimisations.
typedef struct pm_shooting_terms {
    double *noise;   // [ny] `noise` in the objective, unit of the column
    double *gap;     // [nz] `gap` in the objective, unit of the component
    double *prior;   // [nz] `deviation` in the objective; 0: no prior
    bool hold;       // the weights stay as they are; only starts are sought
    bool everywhere; // the starts of later windows have priors, too
    double *later;   // [nz] `deviation` of these
    // [nweight] `first weight` and `reach` in the objective. A reach of 0 means no prior. Weights
    // that do not influence the data stay near their first values.
    double *first_weight, *reach;
    double *early_reach; // [nweight] `reach` while `early` is true
    bool early;
    double huber; // residuals beyond this many deviations count less
} pm_shooting_terms;

// The blocks of the normal equations from the last evaluation with derivatives, and their
// factors after a solution. The last column of an array with nborder columns holds the gradient or
// the gap.
typedef struct pm_shooting_blocks {
    double *matrix;         // [nborder][nborder] block of the weights, upper triangle
    double *own;            // [nwindow][nz][nz] block of the start of each window
    double *border;         // [nwindow][nz][nborder] block that couples a start with the weights
    double *end_by_start;   // [nwindow][nz][nz] derivative of the end by the start, over `gap`
    double *end_by_weights; // [nwindow][nz][nborder] derivative by the weights, over `gap`
    // [nwindow][nweight] zeroed by the caller: an evaluation with derivatives adds the gradient of
    // the samples of each window by the weights; NULL: it does not
    double *window_gradient;
    double *factor;   // [nwindow][nz][nz]
    double *coupling; // [nwindow][nz][nz]
    double *solved;   // [nwindow][nz][nborder]
    double *reduced;  // [nborder][nborder] the matrix after elimination
} pm_shooting_blocks;

#define PM_SHOOTING_LABEL 48 // bytes

typedef struct pm_shooting {
    pm_arena arena;   // owns what does not depend on the windows
    pm_arena divided; // owns the windows and what depends on them
    // The problem, which stays as it was opened.
    pm_sensitivity_how how;
    const pm_tracks *tracks;           // borrowed
    const pm_observation *observation; // borrowed
    int nz, ny, nweight, nborder;      // nborder = nweight + 1: the weights and the gradient
    int nrow;                          // entries of a row of `row`: nz + nborder + 1
    pm_shooting_terms terms;
    int stride; // every so many tracks one is divided into windows; 1 at first
    // The iterate, whose weights are those of the system.
    int nwindow;
    pm_window *window; // [nwindow], by track and time
    double *z;         // [nwindow][nz] the starts
    double *end;       // [nwindow][nz] where the windows end, by the last evaluation
    double *theta;     // [nweight] by the last evaluation
    double **residual; // [tracks->count] -> [count][ny], model minus data by the last evaluation
    double **state;    // [tracks->count] -> [count][nz], the states then
    // [tracks->count] -> [count][ny][nrow], by the last evaluation with derivatives: those
    // of each residual by the start of its window and by the weights, the residual, and its factor,
    // which is the root of Huber's weight over the noise
    double **row;
    double **path; // [tracks->count] -> [steps][nz], states before steps of a few windows
    double work;   // of all evaluations so far: about how many multiplications
    pm_shooting_blocks blocks;
    struct pm_shooting_lane *lane; // [pm_team_lanes(NULL).own] threads
    pm_status failed;              // of the last evaluation: PM_ENOMEM, or PM_OK
    pm_progress progress;          // of the steps that pm_shooting_minimise takes
    char label[PM_SHOOTING_LABEL]; // of this bar; "": none is drawn
} pm_shooting;

// Prepares a fit without windows. All arguments must outlive it. The caller closes it. PM_ENOMEM.
pm_status pm_shooting_open(pm_shooting *s, const pm_sensitivity_how *how, const pm_tracks *tracks);
void pm_shooting_close(pm_shooting *s); // zeroed storage is allowed
// Divides tracks 0, stride, 2 stride, ... into windows of `length` samples; the last window of a
// track has up to half as many samples more. A window keeps its start if one of the previous
// windows began at the same sample. All other starts are taken from the measurements
// (pm_track_sample_states). PM_ENOMEM.
pm_status pm_shooting_divide(pm_shooting *s, int length);
// Removes all windows; the next ones are those of all tracks.
void pm_shooting_clear(pm_shooting *s);

// Integrates all windows with the present weights of the system from the starts z [nwindow][nz].
// Returns the objective, which may not be finite. With `derivatives` it fills the normal equations.
// If there is no memory, it returns NAN and sets s->failed.
double pm_shooting_evaluate(pm_shooting *s, const double *z, bool derivatives);
// Sets the number of steps of the integrator in one dt of the scene for later evaluations.
void pm_shooting_set_substeps(pm_shooting *s, int substeps);

// Eliminates the starts from the damped normal equations, and writes the step of the weights
// [nweight] and of the starts [nwindow][nz]. The diagonal of the starts is multiplied by
// 1 + damping; that of a weight gains `damping` times its geometric mean with the largest. Returns
// false if the equations are singular.
bool pm_shooting_solve(pm_shooting *s, double damping, double *weights, double *z);

typedef struct pm_shooting_progress {
    int iterations;       // steps so far
    int idle;             // the last steps in a row that hardly lowered the objective
    double before, after; // the objective
} pm_shooting_progress;

// When the steps end, and who is told of them.
typedef struct pm_shooting_limits {
    int iterations; // at most
    double enough;  // a step that lowers the objective by less than this fraction
                    // hardly lowers it; two in a row end the steps
    double work;    // ends the steps when that of the shooting exceeds it; 0: no limit
    const volatile sig_atomic_t *stop; // ends the steps when nonzero; or NULL
    // Called before each step, from which the same call goes on with the same bits; or NULL.
    pm_status (*keep)(void *context, const pm_shooting_progress *progress);
    void *context;
} pm_shooting_limits;

// Makes Gauss-Newton steps, bent by geodesic acceleration (Transtrum, Sethna, arXiv:1201.5885).
// Each step raises the damping until the objective falls. The system and s->z then hold the
// resulting weights and starts. *damping is carried over from call to call; 0 at first. *progress
// is all zero at first; otherwise the call goes on from there. PM_EINTERRUPTED if *stop becomes
// nonzero, PM_ENUMERIC if the objective is not finite at the beginning, PM_ENOMEM. Fails as `keep`
// does.
pm_status pm_shooting_minimise(pm_shooting *s, const pm_shooting_limits *limits, double *damping,
                               pm_shooting_progress *progress);
// These functions copy all trained weights from the system to theta [nweight], and back.
void pm_shooting_weights(const pm_shooting *s, double *theta);
void pm_shooting_set_weights(const pm_shooting *s, const double *theta);

#endif
