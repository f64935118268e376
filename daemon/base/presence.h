// A clock that stands still while this process does not run: stopped by a terminal, in a frozen
// container, or without a core to run on. Whoever waits for others must not count its own absence
// as their silence. A pause of a whole host or run then ends no wait.
#ifndef PM_BASE_PRESENCE_H
#define PM_BASE_PRESENCE_H

// The longest time between two looks at the clock that counts as presence, s. Loops that wait look
// at least every 0.1 s.
#define PM_PRESENCE_LONGEST 0.5

// The caller owns this storage and initialises it with zeros.
typedef struct pm_presence {
    double last;   // s, monotonic, at the last look; 0: none yet
    double absent; // s that did not count so far
} pm_presence;

// Takes a look at `now` (s, monotonic) and returns the time of the clock, in s: `now` less the
// absences so far. Of the time since the last look at most PM_PRESENCE_LONGEST counts.
double pm_presence_look(pm_presence *presence, double now);

#endif
