// Deadlines are counted from the first step, so that rounding does not add up.
#include "lockstep/pace.h"

#include <math.h>

pm_pace pm_pace_of(const pm_scene *scene) {
    return (pm_pace){.interval = scene->run.pace > 0 ? scene->physics.dt / scene->run.pace : 0,
                     .begun = -1};
}

void pm_pace_begin(pm_pace *pace, double now) {
    pace->begun = pace->begun < 0 ? now : pace->begun;
}

int64_t pm_pace_limit(const pm_pace *pace, double now) {
    if (pace->interval == 0) {
        return INT64_MAX;
    }
    const double passed = (now - pace->begun) / pace->interval;
    return pace->begun < 0 ? pace->first
           : passed < 1e18 ? pace->first + (int64_t)floor(passed) + 1
                           : INT64_MAX;
}

double pm_pace_due(const pm_pace *pace, int64_t step) {
    // The product is rounded: a time that is a little later is sure to count as due.
    return pace->interval == 0
               ? 0
               : pace->begun + pace->interval * (double)(step - pace->first) * (1 + 1e-12) + 1e-9;
}

void pm_pace_note(pm_pace *pace, int64_t steps, double now) {
    const double late = now - (pace->begun + pace->interval * (double)(steps - pace->first));
    if (pace->interval == 0 || steps == pace->first || late <= 0) {
        return;
    }
    pace->late += 1;
    pace->latest = late > pace->latest ? late : pace->latest;
}
