// The lookahead is the number of steps that the coordinator may grant beyond the last one that
// every process has reported. No process begins a step before all have completed the step one
// `window` earlier. A report shows that a step is complete, at the cost of one message per process.
// A flux shows it too: a process that publishes a flux of step n has completed n steps. If a step
// has one round, the coordinator therefore listens to fluxes, and a report may hold several steps.
// It does so only if reports become at least twice as long, and not in a scene with a tolerance,
// where every report is needed to choose the substeps.
#ifndef PM_LOCKSTEP_LOOKAHEAD_H
#define PM_LOCKSTEP_LOOKAHEAD_H

#include <stdint.h>

#include "scene/scene.h"

// Returns the lookahead: the scene's window, or more if fluxes show progress. In that case it is at
// most half the number of steps between two checkpoints, so that all processes hold a common
// checkpoint.
int pm_lookahead(const pm_scene *scene);

// Returns true if the coordinator learns from fluxes which steps are complete.
bool pm_lookahead_uses_fluxes(const pm_scene *scene);

// Returns the number of steps between two checkpoints: the scene's `checkpoint`, but at least twice
// its window.
int64_t pm_checkpoint_interval(const pm_scene *scene);

// Returns the owner (store/snapshot.h) of the checkpoints of a process, or of the "coordinator".
// The text lies in the arena; NULL: the arena has no memory.
const char *pm_checkpoint_owner(pm_arena *arena, const pm_scene *scene, const char *process);

#endif
