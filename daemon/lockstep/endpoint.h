// An endpoint is the part that nodes and coordinators have in common: the identity, the times at
// which it requests missing messages, the channels that all processes share, and the result of the
// run. An endpoint decodes hello, command and request messages, counts those it drops, and passes
// the others to handlers.
#ifndef PM_LOCKSTEP_ENDPOINT_H
#define PM_LOCKSTEP_ENDPOINT_H

#include <signal.h>
#include <stdbool.h>

#include "base/presence.h"
#include "lockstep/codec.h"
#include "scene/system.h"
#include "transport/transport.h"

// --- identity ---

// The identity of a node or coordinator: the hello with which it announces itself and asks for an
// answer, and the refusal of others that do not fit or that claim the same place. An instance is
// identified by the time at which it was started (ns since 1970), so the older of two rivals is the
// one with the smaller number.
//
// A hello has a nonce, a random number. A message that repeats the nonce is an answer: its sender
// has received this hello. A message that was recorded before the hello cannot repeat the nonce,
// and nobody can guess it.

// The caller owns this storage.
typedef struct pm_identity {
    pm_transport *transport;
    char hello_channel[PM_CHANNEL_SIZE]; // on which this instance publishes hellos
    char command_channel[PM_CHANNEL_SIZE];
    portmet_hello_t hello; // the hello of this instance, with its present nonce
    int64_t answered;      // the last nonce that was answered; 0: none
} pm_identity;

// Publishes the hello. PM_ENET.
pm_status pm_identity_publish_hello(const pm_identity *identity);

// Draws another nonce, since the present one has been answered.
void pm_identity_renew(pm_identity *identity);

// Returns true if a hello comes from another instance of the same process and session.
bool pm_identity_is_rival(const pm_identity *identity, const portmet_hello_t *hello);

// Returns true if this instance was started before `instance`.
bool pm_identity_is_older(const pm_identity *identity, int64_t instance);

// Publishes a command of this instance. An instance that is refused does not end at once: it first
// sends a hello, and ends if a refusal answers that hello. A replayed refusal ends nobody.
// PM_ENET.
pm_status pm_identity_publish_command(const pm_identity *identity, portmet_command_t command);

// Returns true if a command names this instance as its addressee and answers its present hello, or
// the hello whose nonce was last renewed.
bool pm_identity_is_proven(const pm_identity *identity, const portmet_command_t *command);

// --- waiting ---

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
static inline bool pm_waiting_is_long(const pm_waiting *waiting) {
    // Among many processes a request to all costs much, and steps take longer anyway.
    return waiting->interval >= waiting->last &&
           waiting->next - waiting->since >= PM_WAITING_LONG * waiting->first;
}

// Returns true if this wait has lasted for more than `patience` (s) at `now` (s, monotonic), and
// the awaited process, last heard at `heard` (same clock), has been silent for as long.
bool pm_waiting_is_over(const pm_waiting *waiting, double heard, double patience, double now);

// --- the endpoint ---

// The time between two requests to all processes, in s for each process of the run.
#define PM_ENDPOINT_ALL_ASKED 0.02

// Handles a message `data` [size]. Returns PM_KEEP if it is used, or the reason for which it is
// dropped; the endpoint counts both.
typedef pm_drop pm_endpoint_handler(void *context, const void *data, size_t size);

// The owner's handlers of the messages that every endpoint receives.
typedef struct pm_handlers {
    pm_endpoint_handler *hello, *command, *request;
} pm_handlers;

// The caller owns this storage and initialises it with zeros. All pointers are borrowed.
typedef struct pm_endpoint {
    const pm_system *system;
    pm_transport *transport;
    pm_arena *arena;
    pm_identity identity;
    char tick_channel[PM_CHANNEL_SIZE], request_channel[PM_CHANNEL_SIZE];
    char coordinator_address[PM_CHANNEL_SIZE]; // channel of requests to the coordinator
    int64_t session, steps;                    // session and length of the run; session 0: no run
    int64_t attempt;                           // number of rollbacks since the start
    double all_asked_at;                       // s, when it last sent a request to all processes
    double now;                                // s, set by pm_endpoint_look
    pm_presence presence;
    pm_waiting waiting;
    pm_status status;              // result of the run; PM_OK until it has failed
    char message[PM_TEXT_MAX + 1]; // of the failure
    pm_drops drops;                // counts of used and dropped messages
} pm_endpoint;

// Opens an endpoint whose `system`, `transport` and `arena` are set, and subscribes to hellos,
// commands and requests. `handlers`, `context` and `name` must outlive the endpoint. `name` is the
// name of the process, or "" for the coordinator. `session` is the session that the process was
// started for; 0: none was named. `keeps_checkpoints` tells other processes whether this one can
// roll back. The transport keeps pointers to the endpoint, which must not move. PM_ECONFIG: a
// channel's name is too long; PM_ENET, PM_ENOMEM.
pm_status pm_endpoint_open(pm_endpoint *endpoint, const pm_handlers *handlers, void *context,
                           const char *name, int64_t session, bool keeps_checkpoints);

// Passes all messages on a channel to `handler`, with `context`. PM_ENET, PM_ENOMEM.
pm_status pm_endpoint_subscribe(pm_endpoint *endpoint, const char *channel,
                                pm_endpoint_handler *handler, void *context);

// Sets endpoint->now, in s, to `clock`, the present monotonic time in s, minus the total time for
// which this process has not run (base/presence.h). All waiting times refer to endpoint->now, so
// that a process does not count its own absence as the silence of others. The owner calls this
// function at the beginning of each poll.
void pm_endpoint_look(pm_endpoint *endpoint, double clock);

// Returns the monotonic time, in s, at which endpoint->now will reach `time`, in s, if this process
// keeps running.
double pm_endpoint_clock(const pm_endpoint *endpoint, double time);

// Requests the message of `step` and `round` on the channel `channel` from the process that
// publishes there. The request goes to the channel `address`, which only that process and the
// coordinator receive, so that it wakes no other process. During a long wait (pm_waiting_is_long)
// a request now and then goes to all processes: it reveals a second process of the same name.
// PM_ENET, PM_ENOMEM.
pm_status pm_endpoint_request(pm_endpoint *endpoint, const char *address, const char *channel,
                              int64_t step, int round);

// Stores the result of the run: PM_OK, or a failure with its one-line message, which is copied.
void pm_endpoint_end(pm_endpoint *endpoint, pm_status status, const char *message);

// Returns the stored result, with pm_error() set to its message.
pm_status pm_endpoint_result(const pm_endpoint *endpoint);

// Converts an error code that another process has sent to pm_status; PM_ENET if it is unknown.
pm_status pm_endpoint_code(int8_t code);

// Waits for messages and hands them out. Returns at the monotonic time `until`, in s, or 0.1 s
// after the present time `now`, whichever is earlier. PM_EINTERRUPTED: *stop is not 0 (`stop` may
// be NULL); PM_ENET.
pm_status pm_endpoint_wait(pm_endpoint *endpoint, double until, double now,
                           const volatile sig_atomic_t *stop);

#endif
