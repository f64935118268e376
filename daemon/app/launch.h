// Starts, watches and ends the child processes of a run. Each child is a copy of this process
// (fork), so that it has the scene and the weights in memory when it starts: a new program would
// load its libraries and read them again, which takes more time than all else that a small
// subsystem does. At the end each child is terminated if it still runs, and reaped by its process
// id. A child's standard error is kept until it has ended, and its last line becomes this process's
// error, so that a failure is printed once. A child that a signal kills may be started again.
#ifndef PM_APP_LAUNCH_H
#define PM_APP_LAUNCH_H

#include <stdbool.h>

#include "base/journal.h"
#include "base/status.h"

typedef struct pm_launch pm_launch;

// Makes room for `capacity` children, whose lines are passed on to `log`, which must outlive them.
// PM_ENOMEM. The caller closes it.
pm_status pm_launch_open(pm_launch **launch, int capacity, const pm_journal *log);

// The function that a child calls. It gets `context` and the name of the child; the status that it
// returns is the exit code of the child.
typedef struct pm_launch_program {
    pm_status (*run)(void *context, const char *name);
    void *context;
    bool stays; // the child is started again however often it dies
} pm_launch_program;

// Starts a child that runs `program`. Errors call the child `name`, and so do tools that list
// processes. The child keeps the open files that a new program would inherit; it gets SIGTERM when
// this process dies. `progress` is a file that the child replaces as it makes progress, or NULL.
// With it, a child that a signal kills is started again after a short while, with a line on
// standard error, unless it does not stay and has died several times soon after its start without
// progress. The name,
// the context and the path must outlive the child. PM_ENOMEM.
pm_status pm_launch_start(pm_launch *launch, const char *name, pm_launch_program program,
                          const char *progress);

// Looks at the children without waiting. Returns PM_OK as long as none has failed; otherwise the
// first failure, with the child's own exit code, or PM_ENET if a signal killed it. `deaths` (NULL
// is allowed) receives how often signals have killed children so far.
pm_status pm_launch_watch(pm_launch *launch, int *deaths);

// Returns true if child `id`, counted in the order of starting, had ended with exit code 0 at the
// last call of pm_launch_watch.
bool pm_launch_ended_well(const pm_launch *launch, int id);

// Sends a signal to child `id` if it runs.
void pm_launch_signal(pm_launch *launch, int id, int signal_number);

// Waits up to `grace` s for all children to end by themselves and starts none of them again.
// Returns what pm_launch_watch does, or PM_ETIMEOUT if a child still runs, which pm_launch_close
// then ends.
pm_status pm_launch_wait(pm_launch *launch, double grace);

// Ends the children that still run with SIGTERM, then with SIGKILL, and reaps them. NULL is
// allowed.
void pm_launch_close(pm_launch *launch);

#endif
