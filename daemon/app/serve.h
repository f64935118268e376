// A process of a run over LCM: a node, or the coordinator of one or many runs, from the opening of
// its transport to the end of the run.
#ifndef PM_APP_SERVE_H
#define PM_APP_SERVE_H

#include "app/command.h"
#include "library/setup.h"

// Serves the process `process_id` of the setup's scene until the run is over. Returns its result
// (lockstep/node.h), or what opening the transport or the checkpoint returns.
pm_status pm_serve_node(pm_setup *setup, const pm_run_options *options, int process_id);

// Coordinates the processes of the setup's scene, which it launches unless options->elsewhere, and
// answers clients over LCM. Without options->stays a run begins at once: it writes the recording,
// prints the tables at the end, and returns the result of the run (lockstep/coordinator.h). With
// it, it serves the runs that clients start until the user ends it, and returns PM_OK, or PM_ENET
// if the scene is served already. Else returns what opening the recording, the transport or the
// checkpoint returns.
pm_status pm_serve_coordinator(pm_setup *setup, const pm_run_options *options);

#endif
