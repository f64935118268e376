// The samples of a logger's columns, and linear regressions of changes on integrals. For a window
// of samples from t0 to t1, the change y(t1) - y(t0) is compared with the integrals of all columns
// over the window, so that no derivative of noisy samples is needed (weak form, as in Messenger and
// Bortz, J. Comput. Phys. 443, 2021).
#ifndef PM_TRAINER_PROPOSE_LOGGER_SAMPLES_H
#define PM_TRAINER_PROPOSE_LOGGER_SAMPLES_H

#include "propose/logger_view.h"
#include "propose/look.h"

#define PM_LOGGER_BEND 24 // of a cubic polynomial (pm_logger_bend)

// The numbers of all columns, and the windows of the regressions. The view lists the columns.
typedef struct pm_logger_samples {
    pm_logger_view *view;
    int nrow;                      // samples of all trajectories
    double *value;                 // [nrow][PM_LOGGER_COLUMNS]
    double *time;                  // [nrow] s; NaN after the end of a trajectory
    double *sort;                  // [nrow]
    int nwindow, nfeature, length; // windows, their features and samples; length 0: to be divided
    // [nwindow][width] integrals, changes, and 1 for the first window of a trajectory, else 0
    double *window;
    int width; // nfeature + PM_LOGGER_COLUMNS + 1
    pm_least_squares *squares;
    bool seeks_delays; // pm_logger_regress_all finds delays of inputs, too
} pm_logger_samples;

// Return the numbers of all columns at a sample, and its time in s, NaN after the end.
static inline double *pm_logger_row(const pm_logger_samples *w, int trajectory, int sample) {
    return w->value +
           ((ptrdiff_t)trajectory * w->view->dataset->ntime + sample) * PM_LOGGER_COLUMNS;
}
static inline double pm_logger_time(const pm_logger_samples *w, int trajectory, int sample) {
    return w->time[(ptrdiff_t)trajectory * w->view->dataset->ntime + sample];
}

// Returns which of all samples, `ntime` of each trajectory, a column has at sample `k` that is so
// many rows late. It keeps the first and the last one of a trajectory before and behind it.
static inline int pm_logger_earlier(int k, int delay, int ntime) {
    const int at = k % ntime - delay;
    return k - k % ntime + (at < 0 ? 0 : at < ntime ? at : ntime - 1);
}

// Returns by how much the mean of a smooth function over the interval after a sample differs from
// that of both ends, whose values are y[1] and y[2]; y[0] and y[3] are those before and after. With
// it integrals are those of cubic polynomials, since a trapezium is too coarse for few samples in a
// period. Where a neighbour is missing it is 0.
static inline double pm_logger_bend(const double y[4]) {
    const double bend = (y[1] + y[2] - y[0] - y[3]) / PM_LOGGER_BEND;
    return isfinite(bend) ? bend : 0;
}
// Returns the sample before j (away -1) or after the next one (away 2); NULL where it does not
// exist, is not evenly spaced, or where a held input jumps on the way, so that the motion has a
// kink.
static inline const double *pm_logger_near(const pm_logger_samples *w, int trajectory, int j,
                                           int away) {
    const pm_logger_view *v = w->view;
    const int k = j + away;
    bool smooth = v->even && k >= 0 && k < v->dataset->ntime;
    for (int u = v->nvariable; u < v->ncolumn && smooth; ++u) {
        const double now = pm_logger_row(w, trajectory, j)[u];
        const double other = pm_logger_row(w, trajectory, away < 0 ? k : k - 1)[u];
        smooth = !v->column[u].held || other == now;
    }
    return smooth ? pm_logger_row(w, trajectory, k) : NULL;
}

// Finds spacing, range, mean and deviation of column c. An input is `held` if it mostly stays as it
// is, or if it is rough. Returns true if the column is a staircase with wide steps, or constant in
// each trajectory.
bool pm_logger_measure(const pm_logger_samples *w, int c);

// Finds out whether times are even and whether all samples are there, and the noise of variables.
// Then it fills, for regressions, the rows between the samples of columns that are sampled more
// rarely than the others: by cubic polynomials through two samples on each side; a held input stays
// as it is.
void pm_logger_find_noise(pm_logger_samples *w);

// Returns the number of samples in a window for regressions of a variable, such that the variable
// changes by more than its noise over a window.
int pm_logger_window(const pm_logger_samples *w, int target);

// Regresses the changes of a variable on the integrals of the columns in `used`, and on the
// duration, with all windows. Columns count relative to their mean and deviation. Writes
// coefficient [1 + columns], that of the duration first, unless it is NULL. Returns the unexplained
// part of the squares of the changes.
double pm_logger_regress(pm_logger_samples *w, int target, const bool *used, double *coefficient);

// Regresses all variables on all columns, and fills the view's couplings, shares, answers at
// jumps and fastest rate.
void pm_logger_regress_all(pm_logger_samples *w);

#endif
