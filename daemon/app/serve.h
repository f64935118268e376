// A process of a run over LCM: a node, or the coordinator, from the opening of its transport to the
// end of the run.
#ifndef PM_APP_SERVE_H
#define PM_APP_SERVE_H

#include "app/command.h"
#include "library/setup.h"

// Serves the process `process_id` of the setup's scene until the run is over. Returns its result
// (lockstep/node.h), or what opening the transport or the checkpoint returns.
pm_status pm_serve_node(pm_setup *setup, const pm_run_options *options, int process_id);

// Coordinates the processes of the setup's scene, which the caller or a user has started. Writes
// the recording, and prints the tables at the end. Returns the result of the run
// (lockstep/coordinator.h), or what opening the recording, the transport or the checkpoint
// returns.
pm_status pm_serve_coordinator(pm_setup *setup, const pm_run_options *options);

#endif
