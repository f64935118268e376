// A run whose processes are the ranks of one job of mpirun. Rank 0 coordinates, and rank i + 1
// serves process i of the scene.
#ifndef PM_APP_RANKS_H
#define PM_APP_RANKS_H

#include "app/options.h"
#include "library/setup.h"

// Runs this rank's part of the setup's scene, whose URL has ranks (pm_transport_has_ranks). Every
// rank calls it. Returns the result of the run, which rank 0 alone describes. PM_EUSAGE: the job
// has too few or too many ranks, or an option does not work with ranks; else fails as
// pm_serve_node and pm_serve_coordinator do.
pm_status pm_ranks_run(pm_setup *setup, const pm_run_options *options);

#endif
