// A progress bar on standard error, drawn only when that is a terminal. For programs, not
// libraries.
#ifndef PM_BASE_PROGRESS_H
#define PM_BASE_PROGRESS_H

#include <stdbool.h>

// Storage the caller owns.
typedef struct pm_progress {
    bool enabled;
    double started, drawn; // s, monotonic
    const char *label;
    long total;
} pm_progress;

void pm_progress_init(pm_progress *progress, const char *label, long total);
// Redraws at most ten times a second; `detail` (may be NULL) follows the bar.
void pm_progress_update(pm_progress *progress, long done, const char *detail);
// Ends the line.
void pm_progress_finish(pm_progress *progress);

// Seconds of the monotonic clock.
double pm_clock(void);

#endif
