// Supervises a run whose processes may die. The coordinator and the nodes are children of this
// process, which restarts them from their checkpoints.
#ifndef PM_APP_SUPERVISE_H
#define PM_APP_SUPERVISE_H

#include "app/command.h"
#include "library/setup.h"

// Runs the scene, or continues the run whose checkpoints are in the folder options->checkpoint, and
// removes the checkpoints when the run has succeeded. The coordinator prints the tables. Returns
// the coordinator's result; PM_EFILE: another run uses the folder; PM_EINTERRUPTED; what
// pm_launch_watch returns.
pm_status pm_supervise(pm_setup *setup, const pm_run_options *options);

#endif
