// The pace of a run: a step begins no sooner than the clock of this host says, so that simulated
// time follows real time. A step that ends after its deadline counts as late, and the run then goes
// on as fast as it can until it has caught up.
#ifndef PM_LOCKSTEP_PACE_H
#define PM_LOCKSTEP_PACE_H

#include <stdint.h>

#include "scene/scene.h"

// The caller owns this storage.
typedef struct pm_pace {
    double interval; // s of the clock for one step; 0: the run is as fast as it can be
    double begun;    // s, monotonic, when the first step could begin; negative: not yet
    int64_t first;   // steps completed then
    int64_t late;    // steps that ended after their deadline
    double latest;   // s, the longest time by which a step was late
} pm_pace;

// Begins the pace that a scene asks for.
pm_pace pm_pace_of(const pm_scene *scene);

// Says that the first step may begin at `now` (s, monotonic). Later calls change nothing.
void pm_pace_begin(pm_pace *pace, double now);

// Returns the number of steps that may have begun by `now`; INT64_MAX without a pace.
int64_t pm_pace_limit(const pm_pace *pace, double now);

// Returns when the step with this number may begin, s, monotonic; 0 without a pace.
double pm_pace_due(const pm_pace *pace, int64_t step);

// Notes that `steps` steps are complete at `now`.
void pm_pace_note(pm_pace *pace, int64_t steps, double now);

#endif
