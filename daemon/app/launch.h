// Child processes of a run: started from this program's own file, watched, always ended and reaped,
// by process id. What a child writes to standard error is kept until it has ended; the last line
// becomes this process's error, so that a failure is told once.
#ifndef PM_APP_LAUNCH_H
#define PM_APP_LAUNCH_H

#include "base/status.h"

typedef struct pm_launch pm_launch;

pm_status pm_launch_open(pm_launch **launch, int capacity);

// Starts this program with the NULL-terminated `argv` (copied by the start); `name` stands for it
// in errors and must stay. The child gets SIGTERM when this process dies. PM_ENOMEM.
pm_status pm_launch_start(pm_launch *launch, const char *name, const char *const *argv);

// Without waiting: PM_OK as long as no child has failed; else the first failure, with the child's
// own code if it ended with one (PM_ENET if a signal killed it).
pm_status pm_launch_watch(pm_launch *launch);

// Waits up to `grace` seconds for all children to end by themselves; then as _watch, and
// PM_ETIMEOUT if one still runs: it is left to _close.
pm_status pm_launch_wait(pm_launch *launch, double grace);

// Ends what still runs with SIGTERM, then SIGKILL, and reaps it. NULL is allowed.
void pm_launch_close(pm_launch *launch);

#endif
