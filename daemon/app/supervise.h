// A run whose every process may die and returns: the coordinator and the nodes are children, which
// are started again from their checkpoints.
#ifndef PM_APP_SUPERVISE_H
#define PM_APP_SUPERVISE_H

#include "app/setup.h"

// The arguments of a child in the run `session` (text that stays): a node, or with `process` NULL
// the coordinator. Memory of the setup; NULL: there is none.
const char *const *pm_supervise_arguments(pm_setup *setup, const pm_run_options *options,
                                          const char *session, const char *process);

// Runs the scene, or goes on with the run whose checkpoints are there; these are removed when it
// has ended well. The coordinator prints the tables. Returns its result; PM_EFILE: another run uses
// the folder; PM_EINTERRUPTED; what pm_launch_watch returns.
pm_status pm_supervise(pm_setup *setup, const pm_run_options *options);

#endif
