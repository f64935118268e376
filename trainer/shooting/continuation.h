// The continuation of a fit to measurements: from short windows whose gaps hardly count to long
// ones whose gaps are closed, with the noise of each column estimated from the residuals on the
// way.
#ifndef PM_TRAINER_SHOOTING_CONTINUATION_H
#define PM_TRAINER_SHOOTING_CONTINUATION_H

#include "shooting/shooting.h"

#define PM_CONTINUATION_LEAST 2 // samples of the shortest windows
// Before the last point residuals count as noise of at least this fraction of a deviation. Clean
// data would otherwise demand of short windows what the weights cannot fulfil yet.
#define PM_CONTINUATION_EARLY_NOISE 3e-3
// Gaps count like residuals of this many deviations of the noise at the end of the continuation.
#define PM_CONTINUATION_LAST_GAP 0.03

// The stages of a continuation, in their order.
enum {
    PM_CONTINUATION_NONE,   // it has not begun
    PM_CONTINUATION_STARTS, // shortest windows, fixed weights, if something is hidden
    PM_CONTINUATION_SHORT,  // shortest windows
    PM_CONTINUATION_JOIN,   // fixed weights, if something is hidden, when tracks have been added
    PM_CONTINUATION_GROW,   // longer and longer windows
    PM_CONTINUATION_LAST,   // longest windows, noise as given
    PM_CONTINUATION_DONE
};

// A point of the continuation, from which it goes on with the same bits, given the weights,
// windows, starts, noise and gaps of the shooting.
typedef struct pm_continuation_point {
    int stage;  // PM_CONTINUATION_...
    int length; // samples of a window
    int round;  // completed rounds of steps with the same noise
    double factor, damping;
    int finer;                     // how often the substeps have been doubled
    int stride;                    // of tracks: that of the shooting
    double after;                  // the objective after the last round
    double gap;                    // root mean square of gaps then, in deviations of the noise
    pm_shooting_progress progress; // in the present round
} pm_continuation_point;

typedef struct pm_continuation {
    const double *given; // [ny] noise that the user gives, in units of the columns; 0: estimate it
    const double *typical; // [nz] typical size of the changes of hidden components; 0: not known
    int first;             // samples of the first windows; 0: chosen
    bool brief;            // the last point takes no more steps than the others
    bool loud;             // print a line for each window length
    const volatile sig_atomic_t *stop; // ends the fit when nonzero; or NULL
    // Work of the shooting after which the continuation ends where it is; 0: no limit.
    double work;
    // Where the continuation begins. With a stage other than PM_CONTINUATION_NONE the shooting must
    // have the weights, windows, starts, noise and gaps that it had when `keep` got this point.
    pm_continuation_point first_point;
    // Called before each step and at the end of the continuation; or NULL.
    pm_status (*keep)(void *context, const pm_continuation_point *point);
    void *context;
} pm_continuation;

// Returns the length of the first windows: twice as many samples as one needs to find a start.
int pm_continuation_first_length(const pm_shooting *s);
// Runs the continuation from its first point to its end. If the first windows, or those of
// more tracks, cannot be integrated it takes more substeps, weights closer to their declared
// values, other starts of hidden components, and then shorter windows. Windows that cannot be
// integrated in double length stay as they are. *last, unless it is NULL, receives the last point.
// Fails as `keep` does. PM_EINTERRUPTED, PM_ENUMERIC, PM_ENOMEM.
pm_status pm_continuation_run(pm_shooting *s, const pm_continuation *continuation,
                              pm_continuation_point *last);
// Returns the number of samples of the longest track, the length of the last windows of a
// continuation that reaches its end.
int pm_continuation_longest(const pm_shooting *s);

#endif
