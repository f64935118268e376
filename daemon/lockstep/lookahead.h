// How many steps the coordinator may grant beyond the last one that every process has reported. No
// process begins a step before all have completed the step one `window` earlier. A report shows
// that a step is complete, at the price of one message per process. A flux shows it too: a process
// that publishes a flux of step n has completed n steps. Where a step has one round, the
// coordinator therefore listens to fluxes, and reports may hold several steps, if that makes them
// at least twice as long. It does not where the reports choose the substeps (a scene with a
// tolerance).
#ifndef PM_LOCKSTEP_LOOKAHEAD_H
#define PM_LOCKSTEP_LOOKAHEAD_H

#include "scene/scene.h"

// The number of steps: the scene's window, or more if fluxes show progress. It is then at most half
// the steps between two checkpoints, so that all processes hold a common one (checkpoint_ring.h).
int pm_lookahead(const pm_scene *scene);

// True if the coordinator learns from fluxes which steps are complete.
bool pm_lookahead_uses_fluxes(const pm_scene *scene);

#endif
