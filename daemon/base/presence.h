// A clock that stands still while this process does not run, because a terminal has stopped it, its
// container is frozen, or it has no core to run on. A process that waits for others must not count
// its own absence as their silence. With this clock a pause of a whole host or of a whole run ends
// no wait.
#ifndef PM_BASE_PRESENCE_H
#define PM_BASE_PRESENCE_H

// The longest time, in s, between two looks at the clock during which the process counts as
// running. Waiting loops look at least every 0.1 s.
#define PM_PRESENCE_LONGEST 0.5

// The state of the clock. The caller owns it and initialises it with zeros.
typedef struct pm_presence {
    double last;    // s, monotonic, at the last look; 0: none yet
    double absent;  // s in which this process did not run, so far
    double planned; // s that the process waits until the next look on purpose
} pm_presence;

// Updates the clock at `now` (s, monotonic) and returns its time in s: `now` minus all absences so
// far. If more than PM_PRESENCE_LONGEST has passed since the last look, and more than was planned,
// the excess counts as absence.
double pm_presence_look(pm_presence *presence, double now);

#endif
