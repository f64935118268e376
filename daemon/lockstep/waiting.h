// Decides when a process that waits for a message requests it, and when it gives up. The first
// request of a wait comes after a multiple of the usual waiting time. The interval doubles with
// every further request, up to a longest interval. The usual waiting time is a running median, so
// that few requests are needless on a busy machine and a loss costs little time on an idle one.
//
// Requests must not make each other necessary. The kernel offers each datagram to every socket of
// the group, so that a message among n processes costs a time in proportion to n, and a round in
// proportion to n^2. If the machine is slower than the timers expect, every process asks, and the
// questions make it slower still. A process therefore pays for each request from a credit, which
// grows by a part of a request with each message that it uses, and slowly with time. Whatever the
// timers do, requests stay a small part of the traffic, and they are enough for the loss of one
// message in sixteen.
#ifndef PM_LOCKSTEP_WAITING_H
#define PM_LOCKSTEP_WAITING_H

#include <stdbool.h>

// The interval before the first request is at least SOONEST. It is at most FIRST, or more among
// many processes: EACH for each process plus PAIR for each pair of a sender and a receiver, and
// never more than MOST. If no request was needed in the last LATELY waits, the interval is the
// upper limit, because a short timer costs the kernel as much as a message.
#define PM_WAITING_SOONEST 0.0001 // s
#define PM_WAITING_FIRST 0.002    // s
#define PM_WAITING_EACH 0.0001    // s for each process
#define PM_WAITING_PAIR 0.000001  // s for each pair of processes
#define PM_WAITING_MOST 0.5       // s
#define PM_WAITING_LAST 0.1       // s, the longest interval between two requests, at least
#define PM_WAITING_FACTOR 3       // ratio of the first interval to the usual waiting time
#define PM_WAITING_LATELY 1000    // waits
#define PM_WAITING_LONG 20        // pm_waiting_is_long uses this multiple

// The credit of a process, in requests.
#define PM_WAITING_SHARE 0.0625 // with each message that was used
#define PM_WAITING_REFILL 0.004 // s in which all processes that wait alike may send one request
#define PM_WAITING_CREDIT 16    // at most

// The caller owns this storage. Times in s, monotonic.
typedef struct pm_waiting {
    double first, last;           // upper limit of the first interval; the longest interval
    double refill;                // s in which the credit grows by one request
    double credit, credited;      // requests; when it last grew with time
    double since, next, interval; // start of the wait; next request; present interval
    double usual;                 // median of the waiting times; 0: none was measured
    int cautious_waits;           // waits left in which the first request comes early
} pm_waiting;

// Initialises the waiting times of one of `alike` processes that wait for the same things, in a run
// of `processes` processes.
void pm_waiting_init(pm_waiting *waiting, int processes, int alike);

// Ends a wait, if there was one, and begins the next at `now` (s, monotonic).
void pm_waiting_start(pm_waiting *waiting, double now);

// Notes that a message was used, which allows a part of a request.
void pm_waiting_note_used(pm_waiting *waiting);

// Returns true if a request is due at `now` (s, monotonic) and the credit allows it. Then sets the
// time of the next one. Otherwise `next` is the time at which to call this function again.
bool pm_waiting_request_due(pm_waiting *waiting, double now);

// Takes `count` requests that were sent from the credit, which may become negative.
void pm_waiting_note_requests(pm_waiting *waiting, int count);

// Returns true if the interval between requests has reached the longest one, and the wait is as
// long as PM_WAITING_LONG times the upper limit of the first interval.
bool pm_waiting_is_long(const pm_waiting *waiting);

// Returns true if this wait has lasted for more than `patience` (s) at `now` (s, monotonic), and
// the awaited process, last heard at `heard` (same clock), has been silent for as long.
bool pm_waiting_is_over(const pm_waiting *waiting, double heard, double patience, double now);

#endif
