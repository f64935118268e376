// Decides when a process that waits for a message requests it, and when it gives up. The first
// request of a wait comes after a multiple of the usual waiting time. The interval doubles with
// every further request, up to a longest interval. The usual waiting time is a running median, so
// that few requests are needless on a busy machine and a loss costs little time on an idle one.
#ifndef PM_LOCKSTEP_WAITING_H
#define PM_LOCKSTEP_WAITING_H

#include <stdbool.h>

// The interval before the first request is at least SOONEST. It is at most FIRST, or EACH times the
// number of processes if that is more, since a step among many processes takes longer. If no
// request was needed in the last LATELY waits, the interval is the upper limit, because a short
// timer costs the kernel as much as a message.
#define PM_WAITING_SOONEST 0.0001 // s
#define PM_WAITING_FIRST 0.002    // s
#define PM_WAITING_EACH 0.0001    // s for each process
#define PM_WAITING_LAST 0.1       // s, the longest interval between two requests
#define PM_WAITING_FACTOR 3       // ratio of the first interval to the usual waiting time
#define PM_WAITING_LATELY 1000    // waits
#define PM_WAITING_LONG 20        // pm_waiting_is_long uses this multiple

// The caller owns this storage. Times in s, monotonic.
typedef struct pm_waiting {
    double first;                 // upper limit of the first interval
    double since, next, interval; // start of the wait; next request; present interval
    double usual;                 // median of the waiting times; 0: none was measured
    int cautious_waits;           // waits left in which the first request comes early
} pm_waiting;

// Initialises the waiting times for a run of `processes` processes.
void pm_waiting_init(pm_waiting *waiting, int processes);

// Ends a wait, if there was one, and begins the next at `now` (s, monotonic).
void pm_waiting_start(pm_waiting *waiting, double now);

// Returns true if a request is due at `now` (s, monotonic), and then sets the time of the next
// request.
bool pm_waiting_request_due(pm_waiting *waiting, double now);

// Returns true if the interval between requests has reached PM_WAITING_LAST, and the wait is as
// long as PM_WAITING_LONG times the upper limit of the first interval.
bool pm_waiting_is_long(const pm_waiting *waiting);

// Returns true if this wait has lasted for more than `patience` (s) at `now` (s, monotonic), and
// the awaited process, last heard at `heard` (same clock), has been silent for as long.
bool pm_waiting_is_over(const pm_waiting *waiting, double heard, double patience, double now);

#endif
