// Waiting for a message that may have been lost: when to ask for it again, and when to give up.
#ifndef PM_LOCKSTEP_WAITING_H
#define PM_LOCKSTEP_WAITING_H

#include <stdbool.h>

// s between requests: the first comes soon after a loss, each later one twice as late, which spares
// the network. "Soon" is measured in what waits usually take, so that few requests are needless on
// a busy machine, and a loss costs little on an idle one. Where nothing was lost lately the first
// one comes at the latest time: to arm a timer that short costs the kernel as much as a message.
// That time is later where many processes wait for each other: to make a step takes them longer,
// and a request from everybody longer still.
#define PM_WAITING_SOONEST 0.0001
#define PM_WAITING_FIRST 0.002 // at the latest, or
#define PM_WAITING_EACH 0.0001 // times how many processes there are
#define PM_WAITING_LAST 0.1
#define PM_WAITING_FACTOR 3    // first request, in usual waits
#define PM_WAITING_LATELY 1000 // waits

// Storage the caller owns. Times in s, monotonic.
typedef struct pm_waiting {
    double first; // interval, at the latest
    double since, next, interval;
    double usual; // how long waits take, the median; 0: none was measured
    int wary;     // waits to go until the last request is no longer lately
} pm_waiting;

// Among `processes`.
void pm_waiting_init(pm_waiting *waiting, int processes);

// Ends a wait, if there was one, and begins the next.
void pm_waiting_start(pm_waiting *waiting, double now);

// True when it is time to ask again; then the next time is set, twice as far away as the last.
bool pm_waiting_ask(pm_waiting *waiting, double now);

// True when it was asked so often that requests come at the longest interval.
bool pm_waiting_long(const pm_waiting *waiting);

// True when a peer last heard at `heard` has been silent for longer than `patience`, and was waited
// for as long.
bool pm_waiting_over(const pm_waiting *waiting, double heard, double patience, double now);

#endif
