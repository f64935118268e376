// A progress bar on standard error. It is drawn only where standard error is a terminal, or where
// PORTMET_PROGRESS is set, by a program that reads it.
#ifndef PM_BASE_PROGRESS_H
#define PM_BASE_PROGRESS_H

#include <stdbool.h>

// The state of a progress bar. The caller owns the storage.
typedef struct pm_progress {
    bool enabled;
    double started, drawn; // s of pm_clock: the start, and the last redraw
    const char *label;
    long total; // the amount of work, in any unit
} pm_progress;

// Begins a bar for `total` units of work. `label` must outlive the bar.
void pm_progress_init(pm_progress *progress, const char *label, long total);
// Redraws the bar after `done` units, at most ten times a second. `detail` follows the bar; it may
// be NULL.
void pm_progress_update(pm_progress *progress, long done, const char *detail);
// Ends the bar's line.
void pm_progress_finish(pm_progress *progress);
// Removes the bar, if it was drawn, and leaves the line to what comes next.
void pm_progress_erase(pm_progress *progress);

// Returns the monotonic clock's time in s.
double pm_clock(void);

#endif
