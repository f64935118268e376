// How far a run may be ahead of its reports. Nobody is to begin a step before all have completed
// the one `window` before it. A report tells that a step is complete, at the price of a message
// from every process; a flux tells it too: who shows its state at a step has completed those
// before. Where a step has one round, the coordinator listens to fluxes, as many as reports would
// be, and reports wait until there are several steps to tell of, if that makes them more than twice
// as long; not where these choose the substeps.
#ifndef PM_LOCKSTEP_LOOKAHEAD_H
#define PM_LOCKSTEP_LOOKAHEAD_H

#include "scene/scene.h"

// Steps that may be granted beyond the last one that all have reported: the window, or more if
// fluxes hold the processes together; then no more than half the steps between two checkpoints, for
// those to serve (checkpoint_ring.h).
int pm_lookahead(const pm_scene *scene);

// Whether the coordinator learns from fluxes which steps are complete.
bool pm_lookahead_is_heard(const pm_scene *scene);

#endif
