// Child processes of a run: started from this program's own file, watched, always ended and reaped,
// by process id. What a child writes to standard error is kept until it has ended; the last line
// becomes this process's error, so that a failure is told once. A child that a signal kills may be
// started again.
#ifndef PM_APP_LAUNCH_H
#define PM_APP_LAUNCH_H

#include <stdbool.h>

#include "base/status.h"

typedef struct pm_launch pm_launch;

pm_status pm_launch_open(pm_launch **launch, int capacity);

// Starts this program with the NULL-terminated `argv`; `name` stands for it in errors. The child
// gets SIGTERM when this process dies. `progress` (may be NULL) is a file that the child replaces
// as it gets on: killed by a signal, it is started again after a short while, which is told on
// standard error, unless it has died several times without getting on. All text must stay.
// PM_ENOMEM.
pm_status pm_launch_start(pm_launch *launch, const char *name, const char *const *argv,
                          const char *progress);

// Without waiting: PM_OK as long as no child has failed; else the first failure, with the child's
// own code if it ended with one (PM_ENET if a signal killed it).
pm_status pm_launch_watch(pm_launch *launch);

// As of the last watch: child `id`, in the order of starting, has ended for good, and with 0.
bool pm_launch_ended_well(const pm_launch *launch, int id);

// Sends a signal to child `id`, if it runs.
void pm_launch_signal(pm_launch *launch, int id, int signal_number);

// Waits up to `grace` seconds for all children to end by themselves, none of which is started again
// any more; then as _watch, and PM_ETIMEOUT if one still runs: it is left to _close.
pm_status pm_launch_wait(pm_launch *launch, double grace);

// Ends what still runs with SIGTERM, then SIGKILL, and reaps it. NULL is allowed.
void pm_launch_close(pm_launch *launch);

#endif
